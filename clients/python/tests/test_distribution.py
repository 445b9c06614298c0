"""The two distributions of the package, with and without Rust, say the same about it."""

from typing import Any

import pytest
from conftest import ROOT

tomllib: Any = pytest.importorskip("tomllib", reason="it came with Python 3.11")


def test_both_distributions_say_the_same() -> None:
    here, there = ((ROOT / folder / "pyproject.toml").read_text() for folder in ("clients/python", "bindings/python"))
    assert tomllib.loads(here)["project"] == tomllib.loads(there)["project"]
