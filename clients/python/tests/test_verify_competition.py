"""`examples/verify_competition.py`, which follows the documents, checks the ends of attempts in newer formats."""

import hashlib
import json
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import ROOT

PROGRAM = runpy.run_path(str(ROOT / "examples" / "verify_competition.py"))
FIRST = PROGRAM["FIRST_FORMAT_WITH_CHECKED_ATTEMPTS"]
# The end of a window, and a later end that was known from minute 45 on.
ENDS = [("", "2027-03-01T12:50:00Z"), ("2027-03-01T12:45:00", "2027-03-01T13:40:00Z")]


def test_a_voided_attempt_has_its_action() -> None:
    check, record = PROGRAM["check_void"], {"run": "run_1", "voided": "a power cut"}
    check({"format": FIRST}, record, {("run_1", "a power cut")})
    check({"format": FIRST}, {"run": "run_1"}, set())
    for voids in [set(), {("run_2", "a power cut")}, {("run_1", "a bad score")}]:
        check({"format": FIRST - 1}, record, voids)
        with pytest.raises(ValueError, match="no action says so"):
            check({"format": FIRST}, record, voids)


def test_no_game_of_a_finished_attempt_has_closed_with_its_window() -> None:
    def check(file_format: int, status: str, reason: str, end: str) -> None:
        facts = {"status": status}, {"config": {"closes_at": end}}, {"reason": reason}
        PROGRAM["check_ending"]({"format": file_format}, *facts, ENDS)

    last = ENDS[-1][1]
    check(FIRST - 1, "finished", "closed", last)
    check(FIRST, "closed", "closed", last)
    check(FIRST, "finished", "rounds_played", last)
    check(FIRST, "finished", "closed", ENDS[0][1])
    with pytest.raises(ValueError, match="it closed with the window"):
        check(FIRST, "finished", "closed", last)


def test_journals_of_the_next_format_are_read_and_later_ones_refused() -> None:
    lines = (ROOT / "tests" / "golden" / "1" / "flocking-paper.jsonl").read_text(encoding="utf-8").splitlines()
    opening, *rounds, end = [json.loads(line)["record"] for line in lines]
    at, close = opening["created_at"], "2027-03-01T12:50:00Z"
    opening |= {"run": "run_1"}
    opening["config"] |= {"visibility": "sealed", "closes_at": close}
    config = opening["config"]
    attempt = SimpleNamespace(
        plan=[(config["task"], config["seed"])], record={"run": "run_1"}, window={"opens_at": at, "closes_at": close}
    )
    game, entrant = {"slot": 0, "episode": opening["episode"]}, {"model": config["model"]}
    definition = {"settings": config, "rules": config["rules"], "idle_timeout_ms": config["idle_timeout_ms"]}

    def check(journal_format: int) -> None:
        journal = opening | {"format": journal_format}, rounds, end
        PROGRAM["check_journal"](*journal, definition, entrant, attempt, game, [("", close)])

    check(1)
    check(2)
    with pytest.raises(ValueError, match="should be 1 or 2"):
        check(3)


def test_a_field_of_a_later_format_is_refused_in_an_older_file() -> None:
    entrant = dict.fromkeys(["kind", "id", "name", "model", "status", "vouched", "registered_at"])
    PROGRAM["has_fields"]("entrant", entrant, 1)
    PROGRAM["has_fields"]("entrant", entrant | {"terms": 1}, 2)
    with pytest.raises(ValueError, match="format 1 has none of"):
        PROGRAM["has_fields"]("entrant", entrant | {"terms": 1}, 1)


def test_an_action_after_the_end_decides_something() -> None:
    def check(name: str, file_format: int = 3, at: str = "2027-03-01T14:00:00Z", detail: object = None) -> None:
        record = {"action": name, "at": at, "detail": {} if detail is None else detail}
        PROGRAM["read_action"](record, {"format": file_format, "revealed_at": "2027-03-01T14:00:00Z"}, [], set())

    check("entrant.change")
    check("competition.announce", file_format=2)
    check("competition.announce", at="2027-03-01T13:59:59Z")
    with pytest.raises(ValueError, match="after the end"):
        check("competition.announce")
    with pytest.raises(ValueError, match="is no object"):
        check("entrant.change", detail=[])


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999", "[" * 100_000 + "]" * 100_000])
def test_what_is_no_record_is_an_error_and_no_traceback(value: str, tmp_path: Path) -> None:
    record = f'{{"kind":"competition","format":{value}}}'.encode()
    line = b'{"hash":"' + hashlib.sha256(bytes(32) + record).hexdigest().encode() + b'","record":' + record + b"}\n"
    file = tmp_path / "cup.jsonl"
    file.write_bytes(line)
    program = str(ROOT / "examples" / "verify_competition.py")
    done = subprocess.run([sys.executable, program, str(file)], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("line 1: "), done.stderr
    assert "no number of JSON" in done.stderr or "recursion" in done.stderr


def test_names_do_not_act_on_a_terminal() -> None:
    assert PROGRAM["shown"]("blue\x1b[2J\u202e") == "blue\\x1b[2J\\u202e"
    entrant = {"status": "active", "name": "blue\x1b[2J"}
    with pytest.raises(ValueError, match="control characters"):
        PROGRAM["check_entrant"](entrant, {})


def test_published_files_of_earlier_versions_verify_as_they_did() -> None:
    folder = ROOT / "tests" / "golden" / "competitions"
    for line in (folder / "heads.tsv").read_text().splitlines():
        name, _, head, commitment = line.split("\t")
        checked = [str(ROOT / "examples" / "verify_competition.py"), str(folder / name), commitment, head]
        done = subprocess.run([sys.executable, *checked], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{name}: {done.stderr}"
