"""Every code block of docs/play/python.md runs, also in a notebook, and the README shows the agent that is tested."""

import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from conftest import ROOT

from swarmseat import Server

PAGE = (ROOT / "docs" / "play" / "python.md").read_text()
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def test_the_page_works_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    blocks = [(found.start(), found[2]) for found in BLOCK.finditer(PAGE) if found[1] == "python"]
    for place, block in blocks:
        # A failure names the line of the page.
        lines = "\n" * (PAGE.count("\n", 0, place) + 1)
        exec(compile(lines + block, "docs/play/python.md", "exec"), names)
    assert len(blocks) >= 8
    shown = capsys.readouterr().out
    assert "\n10.0\n" in shown
    assert "width must be" in shown
    assert "Synchronization 5.0 ± 0.0" in shown
    # The scores that the page names: the layouts and all draws follow from the seed.
    assert "random:   1.2\n" in shown
    assert "learned:  30.0\n" in shown


@pytest.mark.parametrize("seed", [2, 3])
def test_the_training_learns_with_other_seeds(seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = [block for _, block in BLOCK.findall(PAGE) if "training:" in block]
    seeded = block.replace("seed=1", f"seed={seed}").replace("default_rng(1)", f"default_rng({seed})")
    assert seeded.count(str(seed)) > block.count(str(seed)) + 1
    server = Server().start()
    # At most the steps that the page names: 5 games, 10 of training and 5 more, each of 30 rounds.
    assert block.count("range(5)") == 2
    assert "range(10)" in block
    exec(f"import swarmseat\n{seeded}", {"server": server, "client": server.client()})
    scores = dict(line.split(":") for line in capsys.readouterr().out.splitlines())
    assert float(scores["learned"]) > 5 * float(scores["random"])
    assert float(scores["learned"]) > 25


def test_the_page_works_in_a_notebook(tmp_path: Path) -> None:
    cells = [block for language, block in BLOCK.findall(PAGE) if language == "python"]
    # The page's statements about a notebook's own loop are inserted before the last cell, which stops the server.
    own_loop = "asyncio.get_running_loop()\nawait main()\nkept = swarmseat.AsyncClient(server.url)"
    cells[-1:-1] = [own_loop, "print(await kept.health())\nawait kept.aclose()"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    file = tmp_path / "page.ipynb"
    nbformat.write(notebook, file)
    execute = Path(sys.executable).with_name("jupyter-execute")
    ended = subprocess.run([execute, "--inplace", file], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    outputs = [output for cell in nbformat.read(file, as_version=4).cells for output in cell.outputs]
    shown = "".join(output.get("text", "") for output in outputs)
    assert "learned:  30.0" in shown
    assert "'status': 'ok'" in shown


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
