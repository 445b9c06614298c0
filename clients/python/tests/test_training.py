"""Every Python block of docs/play/training.md runs."""

import re

import pytest
from conftest import ROOT

pytest.importorskip("swarmseat._native", reason="only wheels of bindings/python have the native module")

BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def test_the_page_works_from_top_to_bottom() -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "play" / "training.md").read_text())
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/play/training.md", "exec"), names)
    assert len(blocks) >= 2
