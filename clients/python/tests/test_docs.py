"""Every code block of docs/play/python.md runs, and the README shows the agent that is tested."""

import re

import pytest
from conftest import ROOT

PAGE = (ROOT / "docs" / "play" / "python.md").read_text()
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def test_the_page_works_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    blocks = [(found.start(), found[2]) for found in BLOCK.finditer(PAGE) if found[1] == "python"]
    for place, block in blocks:
        # A failure is told with the line of the page.
        lines = "\n" * (PAGE.count("\n", 0, place) + 1)
        exec(compile(lines + block, "docs/play/python.md", "exec"), names)
    assert len(blocks) >= 8
    shown = capsys.readouterr().out
    assert "\n10.0\n" in shown
    assert "width must be" in shown
    assert "Synchronization 5.0 ± 0.0" in shown


def test_there_is_no_other_code_than_what_is_tested() -> None:
    assert {language for language, _ in BLOCK.findall(PAGE)} == {"python", "sh"}
    # .ci/clients runs this block to install the package that is tested.
    marked = PAGE[PAGE.index("<!-- install -->") : PAGE.index("<!-- end -->")]
    assert [block for language, block in BLOCK.findall(PAGE) if language == "sh"] == [BLOCK.findall(marked)[0][1]]


def test_the_readme_shows_the_minimal_agent() -> None:
    readme = (ROOT / "README.md").read_text()
    shown = readme[readme.index("<!-- minimal agent: python -->") :]
    shown = shown[: shown.index("<!-- end -->")]
    assert BLOCK.findall(shown) == [("python", (ROOT / "examples" / "agents" / "minimal.py").read_text())]
