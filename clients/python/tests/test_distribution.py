"""Both distributions of the package, with and without Rust, describe it alike; neither has a stranger's name."""

import re
import subprocess
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

tomllib: Any = pytest.importorskip("tomllib", reason="it came with Python 3.11")

NAME = "swarmseat"
STRANGERS = "swarmbench"
"""The distribution of this name on the Python package index is another project's."""
OWN = ("clients/python/src/", "clients/python/tests/")
INSTALLS = re.compile(r"\b(?:pipx?|uv|poetry|conda) (?:pip )?(?:install|add|download)\b([^\n`#]*)")
# The name of a package with its extras, not a part of a path or of another name.
LOOKED_UP = re.compile(rf"(?<![\w./-])(?:{STRANGERS}|{NAME})(?:\[[\w,-]*\])?(?![\w/-]|\.\w)")


def table(folder: str) -> Any:
    return tomllib.loads((ROOT / folder / "pyproject.toml").read_text())


def texts() -> list[tuple[str, str]]:
    """All text files of the repository, except stored games."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    names = [name for name in listed.split("\0") if name and not name.startswith("tests/golden/")]
    found = []
    for name in names:
        if (ROOT / name).is_file():
            try:
                found.append((name, (ROOT / name).read_text()))
            except UnicodeDecodeError:
                continue
    return found


def test_both_distributions_say_the_same() -> None:
    here, there = table("clients/python"), table("bindings/python")
    assert here["project"] == there["project"]


def test_what_is_imported_has_the_name_of_what_is_installed() -> None:
    here, there = table("clients/python"), table("bindings/python")
    assert here["project"]["name"] == NAME
    packages = [NAME, f"{NAME}_verifiers"]
    assert here["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == [f"src/{name}" for name in packages]
    assert there["tool"]["maturin"]["python-packages"] == packages
    assert there["tool"]["maturin"]["module-name"] == f"{NAME}._native"
    # No file has the old name, which would hide the other project's package.
    assert sorted(path.name for path in (ROOT / "clients/python/src").iterdir()) == packages
    installed = {Path(file).parts[0] for file in distribution(NAME).files or () if file.suffix == ".py"}
    assert installed == set(packages)


def test_nobody_is_told_to_install_a_package_of_a_stranger() -> None:
    told = [
        f"{name}: {found[0]}"
        for name, text in texts()
        for found in INSTALLS.finditer(text)
        # The package's own messages name extras of what is installed already.
        if any(STRANGERS in one or not name.startswith(OWN) for one in LOOKED_UP.findall(found[1]))
    ]
    assert not told


def test_no_requirement_is_a_package_of_a_stranger() -> None:
    requirements = [text for name, text in texts() if name.endswith("requirements.txt")]
    assert requirements
    assert not [line for text in requirements for line in text.splitlines() if LOOKED_UP.match(line)]
    projects = [tomllib.loads(text)["project"] for name, text in texts() if name.endswith("pyproject.toml")]
    wanted = [line for one in projects for line in one["dependencies"]]
    assert not [line for line in wanted if line.startswith(STRANGERS)]


def test_wheels_have_the_names_that_the_build_gives_them() -> None:
    version = table("bindings/python")["project"]["version"]
    built = re.compile(rf"{NAME}-{re.escape(version)}-cp310-abi3-(?:manylinux_2_\d+_|macosx_)\w+\.whl")
    named = [(file, name) for file, text in texts() for name in re.findall(rf"\b{NAME}-\d[\w.-]*\.whl", text)]
    assert {file for file, _ in named} >= {"docs/play/training.md"}
    assert [one for one in named if not built.fullmatch(one[1])] == []
