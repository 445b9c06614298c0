"""The types and the calls of the wire are generated, so that they cannot drift from the OpenAPI document."""

import subprocess
import sys
from typing import Any

import pytest
from conftest import ROOT
from shapes import fields

from swarmseat import wire

tomllib: Any = pytest.importorskip("tomllib", reason="it came with Python 3.11")

PACKAGE = ROOT / "clients" / "python"


def test_the_generated_files_are_those_of_the_document() -> None:
    subprocess.run([sys.executable, PACKAGE / "generate.py", "--check"], check=True)


def test_fields_that_may_be_left_out_exist() -> None:
    left_out: dict[str, list[str]] = tomllib.loads((PACKAGE / "generate.toml").read_text())["left_out"]
    for name, absent in left_out.items():
        optional = {field for field, (_, may_be_absent) in fields(getattr(wire, name)).items() if may_be_absent}
        assert optional >= set(absent), name
