"""Prints what it costs to compile the program, as Markdown; see `.ci/measure build`.

    build_costs.py FOLDER ARGUMENT…   compiles in FOLDER, which is empty, with these arguments of `cargo build`
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from measured import count, output, table

DEAREST = 20


def compile_(folder: Path, arguments: list[str]) -> list[tuple[str, float]]:
    """The units of a build: libraries, build scripts, their runs, programs. Of each the id of its crate and its processor seconds."""
    subprocess.run(["cargo", "fetch", "--locked", "--quiet"], check=True)
    # With one job, units end one after another, and Cargo tells of each after it has waited for its process.
    command = ["cargo", "build", "--locked", "--offline", "--quiet", "--jobs=1", "--message-format=json-render-diagnostics"]
    environment = {**os.environ, "CARGO_TARGET_DIR": str(folder)}
    built, before = [], 0.0
    with subprocess.Popen([*command, *arguments], env=environment, stdout=subprocess.PIPE, text=True) as cargo:
        for line in cargo.stdout:
            message = json.loads(line)
            if message["reason"] in ("compiler-artifact", "build-script-executed"):
                used = ended_children(cargo.pid)
                built.append((message["package_id"], used - before))
                before = used
    if cargo.returncode:
        raise SystemExit(cargo.returncode)
    return built


def ended_children(process: int) -> float:
    """The processor seconds of the ended children of a process, and of theirs."""
    # After the name in parentheses, the 14th and 15th field.
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[13]) + int(fields[14])) / os.sysconf("SC_CLK_TCK")


def name_of(crate: str) -> str:
    """The name in an id of Cargo, which ends in `#name@version`, or in `/name#version` where the folder has the name."""
    place, _, end = crate.rpartition("#")
    return end.partition("@")[0] if "@" in end else place.rpartition("/")[2]


def graph() -> tuple[dict[str, list[str]], set[str]]:
    """What each crate needs to be compiled, and the crates of the workspace, by their ids."""
    host = re.search(r"^host: (.*)$", output("rustc", "-vV"), re.MULTILINE)[1]
    metadata = json.loads(output("cargo", "metadata", "--locked", "--offline", "--format-version=1", f"--filter-platform={host}"))
    needs = {
        node["id"]: [at["pkg"] for at in node["deps"] if any(kind["kind"] != "dev" for kind in at["dep_kinds"])]
        for node in metadata["resolve"]["nodes"]
    }
    return needs, set(metadata["workspace_members"])


def reached(needs: dict[str, list[str]], root: str, compiled: set[str], without: str | None = None) -> set[str]:
    """The compiled crates that a crate leads to, when one crate is left out."""
    found: set[str] = set()
    ahead = [root]
    while ahead:
        at = ahead.pop()
        if at not in found and at != without and at in compiled:
            found.add(at)
            ahead += needs[at]
    return found


def dependencies(seconds: Counter[str], root: str) -> str:
    """Each dependency of the workspace's crates, with the crates that are compiled for nothing else."""
    needs, members = graph()
    compiled = set(seconds)
    everything = reached(needs, root, compiled)
    rows = []
    for id in {id for member in members & everything for id in needs[member]} & everything - members:
        alone = everything - reached(needs, root, compiled, without=id)
        rows.append((sum(seconds[at] for at in alone), len(alone), name_of(id)))
    rows.sort(reverse=True)
    shown = [row for row in rows if row[0] >= 1]
    lines = [[f"`{name}`", count(crates), f"{cost:.1f}"] for cost, crates, name in shown]
    if rest := rows[len(shown) :]:
        lines.append([f"{len(rest)} others", count(sum(row[1] for row in rest)), f"{sum(row[0] for row in rest):.1f}"])
    return table(["dependency", "crates", "processor seconds"], lines)


def dearest(built: list[tuple[str, float]], seconds: Counter[str]) -> str:
    """The crates that take longest."""
    parts = Counter(crate for crate, _ in built)
    lines = [[f"`{name_of(crate)}`", count(parts[crate]), f"{cost:.1f}"] for crate, cost in seconds.most_common(DEAREST)]
    return table(["crate", "units", "processor seconds"], lines)


def lines_of_rust() -> str:
    """Lines of committed Rust: a row for each crate and each folder of tests."""
    lines: dict[str, Counter[str]] = {}
    for file in filter(None, output("git", "ls-files", "-z", "*.rs").split("\0")):
        parts = Path(file).parts
        at = 2 if parts[0] in ("crates", "bindings", "tests") and len(parts) > 2 else 1
        kind = "tests and benchmarks" if parts[0] == "tests" or parts[at] in ("tests", "benches", "examples") else "code"
        lines.setdefault("/".join(parts[:at]), Counter())[kind] += Path(file).read_bytes().count(b"\n")
    kinds = ("code", "tests and benchmarks")
    cells = lambda of: [*(count(of[kind]) for kind in kinds), count(of.total())]
    rows = [[f"`{name}`", *cells(of)] for name, of in sorted(lines.items())]
    product = sum((of for name, of in lines.items() if name == "src" or name.startswith("crates/")), Counter())
    tests = sum((of for name, of in lines.items() if name.split("/")[0] == "tests"), Counter())
    rows += [["**`src` and `crates`**", *cells(product)], ["**`tests`**", *cells(tests)]]
    return table(["folder", *kinds, "in all"], rows)


def after_a_change() -> str:
    """Seconds from a change of a handler to a debug server that is ready, three times; its build beforehand does not count."""
    build = ["cargo", "build", "--locked", "--quiet", "--bin=swarmbench"]
    subprocess.run(build, check=True)
    metadata = json.loads(output("cargo", "metadata", "--locked", "--offline", "--no-deps", "--format-version=1"))
    program = Path(metadata["target_directory"]) / "debug" / "swarmbench"
    rows = []
    for _ in range(3):
        # Cargo takes a later time of a file for a change.
        Path("src/http/episodes/show.rs").touch()
        began = time.monotonic()
        subprocess.run(build, check=True)
        built = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            serve = [program, "serve", "--addr=127.0.0.1:0", f"--db={folder}/a.db"]
            with subprocess.Popen(serve, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as server:
                next(line for line in server.stdout if "http://" in line)
                ready = time.monotonic()
                server.kill()
        rows.append([f"{built - began:.1f}", f"{ready - began:.1f}"])
    return table(["compiled after, s", "listening after, s"], rows)


def main(folder: Path, arguments: list[str]) -> None:
    built = compile_(folder, arguments)
    seconds: Counter[str] = Counter()
    for crate, used in built:
        seconds[crate] += used
    facts = [
        ["processor seconds", f"{seconds.total():.0f}"],
        ["crates", count(len(seconds))],
        ["units: libraries, build scripts and their runs, programs", count(len(built))],
    ]
    if (program := folder / "release" / "swarmbench").exists():
        facts.append(["size of the program", f"{program.stat().st_size / 1e6:.1f} MB"])
    # The last unit is what was asked for.
    root, _ = built[-1]
    print(f"## `cargo build {' '.join(arguments)}`\n\n{table(['', ''], facts)}")
    print(f"## What each dependency costs\n\n{dependencies(seconds, root)}")
    print(f"## The dearest crates\n\n{dearest(built, seconds)}")
    print(f"## After a change of a handler\n\nA debug server, on {os.cpu_count()} processors.\n\n{after_a_change()}")
    print(f"## Lines of Rust\n\n{lines_of_rust()}", end="")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
