"""The program that was written from the documents checks how attempts of the newer formats ended."""

import runpy

import pytest
from conftest import ROOT

PROGRAM = runpy.run_path(str(ROOT / "examples" / "verify_competition.py"))
FIRST = PROGRAM["FIRST_FORMAT_WITH_CHECKED_ATTEMPTS"]
# The end of a window, and a later one that was known from minute 45 on.
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
