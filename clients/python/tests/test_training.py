"""Every Python block of docs/play/training.md runs, and both distributions describe themselves alike."""

import os
import re
from pathlib import Path

import pytest

pytest.importorskip("swarmseat._native", reason="only wheels of bindings/python have the native module")

ROOT = Path(os.environ.get("SWARMBENCH_ROOT", Path(__file__).resolve().parents[3]))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def test_the_page_works_from_top_to_bottom() -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "play" / "training.md").read_text())
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/play/training.md", "exec"), names)
    assert len(blocks) >= 2


def test_both_distributions_say_the_same() -> None:
    tables = []
    for folder in ("clients/python", "bindings/python"):
        text = (ROOT / folder / "pyproject.toml").read_text()
        tables.append(text[text.index("[project]\n") : text.index("\n[tool.")])
    assert tables[0] == tables[1]
