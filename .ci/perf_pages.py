"""Writes the tables of `.ci/perf` between their marks in docs/operate/load.md and docs/develop/benchmarks.md.

    perf_pages.py machine SETTING     prints on which machine it is measured, as JSON
    perf_pages.py criterion FOLDER    prints the estimates that criterion left there, as JSON
    perf_pages.py pages FOLDER        writes the pages from the measurements there, and prints the rows of the chart
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

DOCS = Path(__file__).resolve().parent.parent / "docs"
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
        "commit": output("git", "describe", "--always", "--abbrev=10", "--dirty= with changes", "--exclude=*"),
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


def put(page: str, name: str, text: str) -> None:
    path = DOCS / page
    before, begin, rest = path.read_text().partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->")
    if not end:
        raise SystemExit(f"{page} has no place for {name}: it needs <!-- {name} --> and <!-- end of {name} -->")
    path.write_text(f"{before}{begin}\n{text.rstrip()}\n\n{end}{after}")


def about(machine: dict) -> str:
    """The machine and the method of the measurements."""
    setting = "" if machine["setting"] == "full" else f" (`SWARMBENCH_PERF={machine['setting']}`: few and short turns)"
    load = machine["load_average"]
    beside = "" if load < 0.5 else "; **other programs ran beside it**, so compare only numbers that were measured in turns"
    text = (
        f"Measured by `.ci/perf`{setting} on {machine['date']}, at commit {machine['commit']}: {machine['processor']}, "
        f"{machine['cores']} cores, {machine['kernel']}, Rust {machine['rust']}, release profile. Load average before: "
        f"{load:.1f}{beside}."
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


def grid(report: dict, engine: float | None) -> str:
    headings = ["episodes", "by", "rounds", "to the end", "success", "acts a second", "rounds a second", "ack p50",
                "ack p99", "wake p50", "wake p99"]
    rows = [
        [count(row["episodes"]), f"`{row['by']}`", count(row["rounds"]), count(row["ended"]),
         percent(row["answers"]["ok"] / max(1, row["answers"]["ok"] + row["answers"]["errors"])), count(row["acts_per_s"]),
         count(row["rounds_per_s"]), *(millis(row[of][at]) for of in ("acknowledged", "woken") for at in ("p50_ms", "p99_ms"))]
        for row in report["play"]
    ]
    held = sum(row["answers"]["held_back"] for row in report["play"])
    beside = "" if engine is None else f" The engine alone resolves {count(engine)} such rounds a second on one core."
    return table(headings, rows, 1) + f"\n{count(held)} answers were held back.{beside}\n"


def polls(reports: Sequence[dict]) -> str:
    lines = []
    for report in reports:
        polls = report["polls"]
        one, all_, held = polls["one_by_one"], polls["all_at_once"], polls["bytes_per_poll"]
        lines.append([
            f"{polls['polls']:,} on {polls['episodes']:,} episodes of {polls['seats']:,} seats",
            *(millis(one[at]) for at in ("p50_ms", "p99_ms", "max_ms")), millis(all_["p99_ms"]), millis(all_["max_ms"]),
            "" if held is None else f"{held / 1000:.1f} kB",
        ])
    headings = ["", "one episode after the other: p50", "p99", "max", "all at once: p99", "max", "memory for each"]
    return table(headings, lines)


KINDS = {
    "head": "a byte of a head now and then",
    "body": "a byte of a body now and then",
    "silent": "nothing at all",
    "unread": "a request a second, and read no answer",
}


def slow(report: dict) -> str:
    slow = report["slow"]
    kept = [
        [KINDS.get(kind["kind"], kind["kind"]), count(kind["clients"]),
         "all" if kind["closed_within_15_s"] >= kind["clients"] else count(kind["closed_within_15_s"]),
         count(kind["open_after_15_s"]), f"{kind['longest_s']:.1f} s"]
        for kind in slow["kept"]
    ]
    honest = [
        [name, *(millis(side[of][at]) for of in ("acknowledged", "looked") for at in ("p50_ms", "p99_ms"))]
        for name, side in [("alone", slow["before"]), ("beside slow ones", slow["during"])]
    ]
    headings = ["they send", "clients", "closed within 15 s", "still open after 15 s", "longest connection"]
    return (
        f"{count(slow['clients'])} at once for {slow['seconds']:g} s:\n\n" + table(headings, kept) + "\n"
        + table(["honest clients", "act p50", "act p99", "look p50", "look p99"], honest)
        + f"\nThe p99 of acts grew {slow['acknowledged_factor']:.2f} times, that of looks {slow['looked_factor']:.2f} times.\n"
    )


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


def chart(reports: dict) -> str:
    """Lines `group, label, value, limit, text`, for the example `bars` of crates/replay."""
    lines = []
    if (obs := reports.get("obs")) is not None:
        looks = obs["obs"]
        lines.append(["Looks a second, beside a bare handler", "GET /obs", looks["server"]["per_s"], looks["bare"]["per_s"],
                      percent(looks["ratio"])])
    for row in (reports.get("acts") or {}).get("acts", []):
        lines.append(["Durable acts a second, beside a bare writer", f"{row['by']}, {row['episodes']} episodes",
                      row["acts_per_s"], row["bare_acts_per_s"], percent(row["ratio"])])
    speeds = {(row["group"], row["function"]): 1e9 / row["ns"] for row in reports.get("rounds") or []}
    for task in TASKS:
        observed, plain = speeds.get(("play_and_observe", task)), speeds.get(("play", task))
        if observed and plain:
            lines.append(["Rounds a second of the engine with all observations, beside rounds without", task, observed, plain,
                          count(round(observed, -3))])
    return "".join("\t".join(map(str, line)) + "\n" for line in lines)


def pages(folder: Path) -> str:
    """Writes the pages. Tables without a measurement stay as they are."""
    reports = {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
    engine = [1e9 / row["ns"] for row in reports.get("rounds", []) if (row["group"], row["function"]) == ("play", "Synchronization")]
    load, benchmarks = "operate/load.md", "develop/benchmarks.md"
    made: list[tuple[str, str, str, Callable[[], str]]] = [
        (load, "machine", "machine", lambda: about(reports["machine"])),
        (load, "looks", "obs", lambda: looks(reports["obs"])),
        (load, "acts", "acts", lambda: acts(reports["acts"])),
        (load, "grid", "play", lambda: grid(reports["play"], engine[0] if engine else None)),
        (load, "polls", "polls", lambda: polls([reports[of] for of in ("polls", "crowd") if of in reports])),
        (load, "slow", "slow", lambda: slow(reports["slow"])),
        (benchmarks, "machine", "machine", lambda: about(reports["machine"])),
        (benchmarks, "rounds", "rounds", lambda: rounds(reports["rounds"])),
        (benchmarks, "flocking", "flocking", lambda: by_size(reports["flocking"], "distance",
         ["random", "corner", "crowds", "diagonal", "nearly formed"], "agents, map", FLOCK_GOALS)),
        (benchmarks, "growth", "growth", lambda: growth(reports["growth"])),
    ]
    for page, name, measured, make in made:
        if measured in reports:
            put(page, name, make())
    if (boards := folder / "boards.md").exists():
        text = boards.read_text()
        put(load, "boards", "".join(line + "\n" for line in text.splitlines() if line.startswith("|")))
    return chart(reports)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["machine", setting]:
            print(json.dumps(machine(setting), indent=1))
        case ["criterion", folder]:
            print(json.dumps(criterion(Path(folder)), indent=1))
        case ["pages", folder]:
            print(pages(Path(folder)), end="")
        case _:
            raise SystemExit(__doc__)
