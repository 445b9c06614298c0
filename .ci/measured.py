"""The pages of `docs/measured`: their heads, and the numbers of `.ci/measure`.

    measured.py machine SETTING       prints on which machine it is measured, as JSON
    measured.py criterion FOLDER      prints the estimates that criterion left there, as JSON
    measured.py head NAME             prints the head of the page NAME, measured now on this machine
    measured.py page NAME FOLDER      prints the page NAME of the measurements there
"""

import datetime
import json
import math
import os
import platform
import re
import statistics
import subprocess
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"]
# Goals of the engine, by measurement.
ROUND_GOALS = {"play": 100_000, "play_and_observe": 30_000}
FLOCK_GOALS = {"12, 10 × 10": 5e4, "30, 16 × 16": 1e6, "100, 28 × 28": 5e7, "256, 100 × 100": 1e9}
ROUND_NAMES = {
    "play": "round and digest",
    "play_and_observe": "with all observations",
    "play_and_write": "with all present windows written",
}


def output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def machine(setting: str) -> dict[str, object]:
    """The machine, its other load, and the commit."""
    processor = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return {
        "setting": setting,
        "date": datetime.date.today().isoformat(),
        "processor": processor[1] if processor else platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "kernel": f"{platform.system()} {platform.release()}",
        "rust": output("rustc", "--version").split()[1],
        "load_average": os.getloadavg()[0],
        "commit": output("git", "describe", "--always", "--abbrev=12", "--dirty= with changes", "--exclude=*"),
    }


def criterion(folder: Path) -> list[dict[str, object]]:
    """Each benchmark: its group, function and value, and nanoseconds of one element."""
    rows = []
    for path in sorted(folder.glob("**/new/benchmark.json")):
        about = json.loads(path.read_text())
        estimates = json.loads(path.with_name("estimates.json").read_text())
        elements = (about.get("throughput") or {}).get("Elements", 1)
        rows.append({
            "group": about["group_id"],
            "function": about["function_id"],
            "value": about["value_str"],
            "ns": estimates["median"]["point_estimate"] / elements,
        })
    return rows


def count(value: float) -> str:
    return f"{value:,.0f}"


def significant(value: float, digits: int = 2) -> str:
    places = max(0, digits - 1 - math.floor(math.log10(value))) if value > 0 else 0
    return f"{value:,.{places}f}"


def time(nanoseconds: float | None) -> str:
    if nanoseconds is None:
        return ""
    for unit, size in [("s", 1e9), ("ms", 1e6), ("µs", 1e3)]:
        if nanoseconds >= 0.9995 * size:
            return f"{significant(nanoseconds / size)} {unit}"
    return f"{nanoseconds:.0f} ns"


def millis(value: float) -> str:
    return f"{value / 1e3:.1f} s" if value >= 1000 else f"{value:.0f} ms" if value >= 10 else f"{value:.1f} ms"


def micros(value: float | None) -> str:
    return "" if value is None else f"{value:.1f} µs"


def percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], text: int = 0) -> str:
    """A Markdown table. All columns except that of texts are numbers."""
    marks = ["---" if at == text else "---:" for at in range(len(headings))]
    return "".join(f"| {' | '.join(row)} |\n" for row in [headings, marks, *rows])


def head(name: str, machine: dict) -> str:
    """The beginning of each page: its title, its script, and what was measured."""
    page = PAGES[name]
    when = f"Written by `{page.command}` on {machine['date']}, of the commit {machine['commit']}, on {machine['cores']} processors."
    return "\n\n".join([f"# {page.title}", when, *([page.introduction] if page.introduction else [])]) + "\n"


# The second line of a page, of one whose numbers are older than what its script prints now, and of one without numbers.
WRITTEN = re.compile(r"Written by `(?P<command>.+)` on [\d-]+, of the commit [0-9a-f]+(?: with changes)?, on \d+ processors\.")
OLDER = re.compile(r"Measured on [\d-]+, added by the commit [0-9a-f]+, on \d+ processors[^.]*\. `(?P<command>.+)` writes this page anew\.")
EMPTY = re.compile(r"`(?P<command>.+)` writes this page\. It has not run [^.]*\.\n?")


def problem(file: Path) -> str | None:
    """Why a file of `docs/measured` is no page of a script; None where it is one."""
    if not (page := PAGES.get(file.stem)):
        return "no page in .ci/measured.py"
    title, when, rest = f"{file.read_text()}\n\n".split("\n\n", 2)
    named = WRITTEN.fullmatch(when) or OLDER.fullmatch(when) or EMPTY.fullmatch(when)
    begins = named and (named.re is EMPTY or rest.startswith(page.introduction))
    if title != f"# {page.title}" or not begins or named["command"] != page.command:
        return "the head is not that of .ci/measured.py"
    script = Path(page.command.split()[0])
    return None if file.stem in (file.parents[2] / script).read_text() else f"{script} does not write it"


def conditions(machine: dict) -> str:
    """What else was measured with: a measurement that is kept may be older than its page."""
    setting = "" if machine["setting"] == "full" else f", with `SWARMBENCH_MEASURE={machine['setting']}`: few and short turns"
    load = machine["load_average"]
    beside = "" if load < 0.5 else "; **other programs ran beside it**"
    text = (
        f"Measured on {machine['date']}{setting}, at commit {machine['commit']}: {machine['processor']}, {machine['cores']} cores, "
        f"{machine['kernel']}, Rust {machine['rust']}, release profile. Load average before: {load:.1f}{beside}."
    )
    return textwrap.fill(text, 128, break_on_hyphens=False)


def looks(report: dict) -> str:
    looks = report["obs"]
    rows = [
        [name, count(side["per_s"]), count(side["per_s_min"]), count(side["per_s_max"]), millis(side["latency"]["p50_ms"]),
         millis(side["latency"]["p99_ms"]), micros(side["cpu_us"])]
        for name, side in [("server", looks["server"]), ("bare handler", looks["bare"])]
    ]
    headings = [
        f"`GET /obs`, {looks['connections']} connections, {looks['bytes']:,} bytes",
        "requests a second", "slowest turn", "fastest turn", "p50", "p99", "processor time for one",
    ]
    alone = "" if looks["cpu_ratio"] is None else f"; by processor time alone it is {percent(looks['cpu_ratio'])}"
    return table(headings, rows) + (
        f"\nThe server answers {percent(looks['ratio'])} as many looks as the bare handler{alone}. Median of "
        f"{looks['turns']} turns of {looks['turn_s']:g} s.\n"
    )


def acts(report: dict) -> str:
    headings = ["episodes", "by", "acts a second", "entries a commit", "ack p50", "ack p99", "p99 at half the rate",
                "processor time an act", "bare writer, acts a second", "of the bare writer",
                "bare server, acts a second", "of the bare server"]
    rows = [
        [count(row["episodes"]), f"`{row['by']}`", count(row["acts_per_s"]), count(row["entries_per_commit"]),
         millis(row["acknowledged"]["p50_ms"]), millis(row["acknowledged"]["p99_ms"]),
         millis(row["acknowledged_at_half"]["p99_ms"]), micros(row["cpu_us"]),
         count(row["bare_acts_per_s"]), percent(row["ratio"]),
         count(row["bare_server_acts_per_s"]), percent(row["bare_server_ratio"])]
        for row in report["acts"]
    ]
    return table(headings, rows, 1)


def grid(report: dict) -> str:
    headings = ["episodes", "by", "rounds", "to the end", "success", "acts a second", "rounds a second", "ack p50",
                "ack p99", "wake p50", "wake p99"]
    rows = [
        [count(row["episodes"]), f"`{row['by']}`", count(row["rounds"]), count(row["ended"]),
         percent(row["answers"]["ok"] / max(1, row["answers"]["ok"] + row["answers"]["errors"])), count(row["acts_per_s"]),
         count(row["rounds_per_s"]), *(millis(row[of][at]) for of in ("acknowledged", "woken") for at in ("p50_ms", "p99_ms"))]
        for row in report["play"]
    ]
    held = sum(row["answers"]["held_back"] for row in report["play"])
    return table(headings, rows, 1) + f"\n{count(held)} answers were held back.\n"


def polls(report: dict) -> str:
    polls = report["polls"]
    one, all_, held = polls["one_by_one"], polls["all_at_once"], polls["bytes_per_poll"]
    row = [
        f"{polls['polls']:,} on {polls['episodes']:,} episodes of {polls['seats']:,} seats",
        *(millis(one[at]) for at in ("p50_ms", "p99_ms", "max_ms")), millis(all_["p99_ms"]), millis(all_["max_ms"]),
        "" if held is None else f"{held / 1000:.1f} kB",
    ]
    headings = ["", "one episode after the other: p50", "p99", "max", "all at once: p99", "max", "memory for each"]
    return table(headings, [row])


def rounds(rows: list[dict]) -> str:
    """Rounds per second: one line per task, one column per way of playing."""
    speeds = {(row["group"], row["function"]): 1e9 / row["ns"] for row in rows}
    found = {way for way, _ in speeds}
    ways = [*(way for way in ROUND_NAMES if way in found), *sorted(found - set(ROUND_NAMES))]
    cell: Callable[[float | None], str] = lambda speed: "" if speed is None else count(round(speed, -3))
    lines = [[task, *(cell(speeds.get((way, task))) for way in ways)] for task in TASKS]
    medians = [statistics.median(speed for (of, _), speed in speeds.items() if of == way) for way in ways]
    lines.append(["**median**", *(f"**{cell(median)}**" for median in medians)])
    lines.append(["goal", *(cell(ROUND_GOALS.get(way)) for way in ways)])
    return table(["task", *(ROUND_NAMES.get(way, way.replace("_", " ")) for way in ways)], lines)


def by_size(rows: list[dict], prefix: str, order: Sequence[str], corner: str, goals: dict[str, float]) -> str:
    """Times: a line for agents and map, a column for each group below `prefix`."""
    size: Callable[[dict], tuple[int, int]] = lambda row: (int(row["function"]), int(row["value"].partition("x")[0]))
    rows = [row for row in rows if row["group"].startswith(f"{prefix}/")]
    times = {(size(row), row["group"].removeprefix(f"{prefix}/")): row["ns"] for row in rows}
    found = {group for _, group in times}
    groups = [*(group for group in order if group in found), *sorted(found - set(order))]
    lines = []
    for agents, side in sorted({size for size, _ in times}):
        name = f"{agents:,}, {side} × {side}"
        goal = [time(goals.get(name))] if goals else []
        lines.append([name, *(time(times.get(((agents, side), group))) for group in groups), *goal])
    if prefix.startswith("growth"):
        sizes = sorted({size for size, _ in times})
        least, most = sizes[0], next(size for size in sizes if size[0] == sizes[-1][0])
        name = f"{least[0]:,} → {most[0]:,} agents (× {most[0] / least[0]:.0f})"
        factors = [(times.get((least, group)), times.get((most, group))) for group in groups]
        lines.append([name, *(f"× {after / before:.0f}" if before and after else "" for before, after in factors)])
    return table([corner, *groups, *(["goal (random)"] if goals else [])], lines)


def growth(rows: list[dict]) -> str:
    text = by_size(rows, "growth", TASKS, "agents, map", {})
    if any(row["group"].startswith("growth_windows/") for row in rows):
        text += "\nThe same with all present windows written into buffers, in the place of the observations:\n\n"
        text += by_size(rows, "growth_windows", TASKS, "agents, map", {})
    return text


def size(number: float) -> str:
    for unit, bytes_ in [("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)]:
        if number >= bytes_:
            return f"{number / bytes_:.2f} {unit}"
    return f"{number:.0f} B"


def seconds(value: float) -> str:
    return f"{value:.0f} s" if value >= 10 else f"{value:.1f} s"


def memory(value: float | None) -> str:
    return "" if value is None else f", {size(value)} of memory"


def filled(report: dict) -> list[list[str]]:
    """The database, and a server's start on it."""
    filled, measured = report["filled"], report["measured"]
    return [
        ["games, of runs", f"{count(filled['episodes'])}, of {count(filled['runs'])}"],
        ["the database", f"{size(filled['bytes'])}: {count(filled['bytes'] / max(1, filled['episodes']))} bytes a game"],
        ["made in", seconds(filled["seconds"])],
        ["start until ready", millis(measured["ready_ms"])],
        ["first read of the leaderboard", millis(measured["first_board_ms"])],
        ["memory of the server, at most", size(measured["server_memory_bytes"] or 0)],
        *published(measured.get("competition")),
    ]


def published(file: dict | None) -> list[list[str]]:
    """The export of a competition, and its verification."""
    if file is None:
        return []
    export, verified = file["export_seconds"], file["verify_seconds"]
    return [
        ["export of a competition", f"{count(file['games'])} games, {size(file['export_bytes'])} in {seconds(export)}: "
         f"{size(file['export_bytes'] / export)} a second"],
        ["its verification", f"{count(file['rounds'])} rounds in {seconds(verified)}: {count(file['rounds'] / verified)} a second"
         f"{memory(file['verify_memory_bytes'])}"],
    ]


def capacity(report: dict) -> str:
    measured = report["measured"]
    rebuilt = measured["rebuild"]
    facts = filled(report) + [
        ["board rebuild", f"{count(rebuilt['results'])} results in {seconds(rebuilt['seconds'])}{memory(rebuilt['memory_bytes'])}"]]
    reads = measured["reads"]
    rows = [
        [line["read"], count(line["different"]), millis(line["first"]["max_ms"]), millis(line["latency"]["p50_ms"]),
         millis(line["latency"]["p99_ms"])]
        for line in reads["lines"]
    ]
    heading = f"read, {reads['clients']} clients at once, {count(reads['requests'])} times"
    return table(["on that database", ""], facts) + "\n" + table([heading, "different", "first: max", "later: p50", "p99"], rows)


def competition(report: dict) -> str:
    read = report["measured"]["while_games_end"]
    spread: Callable[[dict], list[str]] = lambda of: [millis(of[at]) for at in ("p50_ms", "p99_ms", "max_ms")]
    rows = [
        [f"{line['by']}: {line['read']}{'' if line['is_page'] else ', whole'}", count(line["latency"]["count"]), *spread(line["latency"])]
        for line in read["lines"]
    ]
    rows.append(["a player: receipt of a round", count(read["acted"]["count"]), *spread(read["acted"])])
    about = (
        f"{read['ended_per_s']:.1f} games a second ended, {read['readers']} readers at once for {seconds(read['seconds'])}.\n\n"
    )
    return table(["on that database", ""], filled(report)) + "\n" + about + table(
        ["who reads what", "reads", "p50", "p99", "max"], rows)


Section = tuple[str, str, Callable[[dict], str]]
"""A heading, the measurement below it, and its text."""


class Page(NamedTuple):
    """What a page says but its numbers. A page without sections gets its numbers from the script itself."""

    title: str
    command: str
    introduction: str
    sections: Sequence[Section] = ()


PAGES = {
    "attacks": Page("The attacks", ".ci/measure attacks", """\
Release profile, eight seconds of each attack, the databases on a disk. Attackers, honest client and server share the processors.
`holds`: all that must hold does."""),
    "baselines": Page("Scores of the built-in players", ".ci/baselines", """\
Players follow from their seed (1), so the scores are the same on every machine."""),
    "boards": Page("Boards", ".ci/measure boards", "[The load test](../operate/load.md#boards) says what is measured."),
    "build": Page("What compiling costs", ".ci/measure build", """\
The program is compiled from nothing, one unit at a time. Processor seconds of a dependency are those of the crates that would not be
compiled without it, of which the first column has the number; crates that two dependencies need count for neither."""),
    "campaign": Page("The campaign", ".ci/long", """\
One server is killed again and again, then the servers of a cluster on one PostgreSQL are killed, stopped and cut off, while clients
play. [The campaign](../develop/campaign.md) says what must hold."""),
    "capacity": Page("A million episodes", ".ci/measure capacity", "[The load test](../operate/load.md#large-databases) says what is measured.", [
        ("The server on a large database", "capacity", capacity),
    ]),
    "checks": Page("Checks", ".ci/full", "Tests are those of cargo, pytest and node; ignored are those that did not run."),
    "cluster": Page("A cluster beside one server", ".ci/measure cluster", """\
One server, and a cluster of three that share one PostgreSQL, all behind haproxy; games of 12 seats, of which each acts by `/act`,
as the load test's [client](../operate/load.md#what-is-measured) does. Clients, load balancer, servers and PostgreSQL share the
processors, so more servers cannot be faster than one; the three have [one thread each](../operate/cluster.md#start) for rounds.
Medians of several turns; a ratio is of one turn. *Forwarded* is the share of the requests of players that a server sent on to
the one that plays."""),
    "competition": Page(
        "A competition of a million attempts", ".ci/measure competition", "[The load test](../operate/load.md#large-databases) says what is measured.", [
        ("Its pages while games end", "competition", competition),
    ]),
    "losses": Page("What decisions of built-in players lost", ".ci/losses", """\
24 pairs of a task and a player, on the layouts 0 to 4 in the standard setting (12 agents, 10 × 10 cells, 100 rounds, rules `paper`), with
another player seed for each layout. [Worth](../evaluate/worth.md) defines what could be scored and what a decision lost."""),
    "worth": Page("Times of worths", ".ci/measure worth", """\
The worth of all states of a game of `random` in the standard setting (12 agents, 100 rounds), and with the losses of all seats, on one
core ([what that is](../evaluate/worth.md)). Medians of three layouts, and the longest of them."""),
    "coverage": Page("Coverage of intervals", ".ci/measure coverage", """\
How often the interval of a difference contains the true difference, in 4,000 samples each: of tasks × seeds with differences from
known distributions, and of games of pairs of built-in players."""),
    "embedders": Page("hash-1 and a sentence model", ".ci/embedder --write", ""),
    "engine": Page("The engine", ".ci/measure engine", "[Benchmarks of the engine](../develop/benchmarks.md) says what is measured.", [
        ("Rounds a second", "rounds", rounds),
        ("The cost of a flock", "flocking", lambda rows: by_size(rows, "distance",
         ["random", "corner", "crowds", "diagonal", "nearly formed"], "agents, map", FLOCK_GOALS)),
        ("Growth", "growth", growth),
    ]),
    "insight": Page("Games of built-in players, analysed", ".ci/insight", """\
Players and layouts follow from their seeds, so the games are the same on every machine.
[What can be read from these tables](../evaluate/insight.md), and what cannot."""),
    "learning": Page("Learned policies", ".ci/measure learning", """\
The [commands of the learner](../play/learning.md#do-it-yourself): `ppo.py` learns, and `play.py` prints the scores on the board, with
intervals of 95 %."""),
    "load": Page("The server under load", ".ci/measure load", "[The load test](../operate/load.md) says what the columns mean.", [
        ("Looks", "obs", looks),
        ("Durable acts", "acts", acts),
        ("Games at once", "play", grid),
        ("Requests that wait, on episodes of 12 seats", "polls", polls),
        ("Requests that wait, on episodes of 1,000 seats", "crowd", polls),
    ]),
    "training": Page("Environments in process", ".ci/measure training", """\
Release profile. Medians of five turns in the standard setting: 12 agents, memory 0, random actions, by the clock. A step is a round of
a whole episode; for steps of agents multiply by 12."""),
}


def page(name: str, folder: Path) -> str:
    parts = []
    machines = []

    def measured(file: str) -> dict:
        machines.append(json.loads((folder / f"{file}.machine").read_text()))
        return machines[-1]

    for heading, measurement, make in PAGES[name].sections:
        if (file := folder / f"{measurement}.json").exists():
            parts += [f"## {heading}", conditions(measured(file.name)), make(json.loads(file.read_text())).rstrip()]
    if name == "boards":
        parts += [conditions(measured("boards.md")), (folder / "boards.md").read_text().rstrip()]
    # The newest measurement dates the page.
    newest = max(machines, key=lambda machine: machine["date"])
    return "\n\n".join([head(name, newest).rstrip(), *parts]) + "\n"


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["machine", setting]:
            print(json.dumps(machine(setting), indent=1))
        case ["criterion", folder]:
            print(json.dumps(criterion(Path(folder)), indent=1))
        case ["head", name]:
            print(head(name, machine("full")))
        case ["page", name, folder]:
            print(page(name, Path(folder)), end="")
        case _:
            raise SystemExit(__doc__)
