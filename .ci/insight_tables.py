"""Writes the tables of docs/evaluate/insight.md between their marks, and docs/measured/embedders.md; see `.ci/insight`."""

import datetime
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from scipy import stats

from swarmseat import analysis
from swarmseat.analysis.metrics import COMMUNICATION, TWELVE
from swarmseat.analysis.statistics import benjamini_hochberg, is_constant

PAGES = Path(__file__).resolve().parent.parent / "docs" / "evaluate"
SHORT = re.compile("^built-in/")


def number(value: float, digits: int = 2) -> str:
    return "" if pd.isna(value) else f"{round(value, digits) + 0.0:.{digits}f}"


def outside(value: float) -> str:
    """R² for players that were left out of the fit, which can be far below 0."""
    return "< -1000" if value < -1000 else number(value)


def chance(value: float) -> str:
    """A p or q as text."""
    return "" if pd.isna(value) else f"{value:.3f}" if value >= 0.001 else "< 0.001"


def interval(low: float, high: float) -> str:
    return "" if pd.isna(low) else f"{number(low)} to {number(high)}"


def code(name: object) -> str:
    return f"`{SHORT.sub('', str(name))}`"


def lines(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table. Columns of numbers are aligned to the right."""
    numeric = [all(re.match(r"(< |-)?[\d.]|$", row[at]) for row in rows) for at in range(len(headings))]
    marks = ["---:" if right else "---" for right in numeric]
    return "".join(f"| {' | '.join(row)} |\n" for row in [headings, marks, *rows])


def put(page: str, name: str, table: str) -> None:
    path = PAGES / page
    before, begin, rest = path.read_text().partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->")
    if not end:
        raise SystemExit(f"{page} has no place for the table {name}")
    path.write_text(f"{before}{begin}\n{table}\n{end}{after}")


def measured(name: str, title: str, text: str) -> None:
    """Writes a page of measurements, with its date and commit."""
    describe = ["git", "describe", "--always", "--abbrev=12", "--dirty= with changes", "--exclude=*"]
    commit = subprocess.run(describe, capture_output=True, text=True, check=True).stdout.strip()
    made = (
        f"Written by `.ci/insight` on {datetime.date.today()}, of the commit {commit}, on {os.cpu_count()} processors."
    )
    (PAGES.parent / "measured" / f"{name}.md").write_text(f"# {title}\n\n{made}\n\n{text}")


CORRELATION = ["r", "p", "q", "interval", "by models", "Spearman", "players", "n"]


def correlation(row: pd.Series) -> list[str]:
    return [
        number(row["r"], 3),
        chance(row["p"]),
        chance(row.get("q", float("nan"))),
        interval(row["low"], row["high"]),
        interval(row["boot_low"], row["boot_high"]),
        number(row["spearman"]),
        str(row["models"]),
        str(row["n"]),
    ]


def tops(table: pd.DataFrame) -> str:
    """The metric with the largest |r| of each task and block."""
    rows = []
    for task, own in table.groupby("task"):
        for name, words in (("physical", False), ("communication", True)):
            known = own[own["metric"].isin(COMMUNICATION) == words].dropna(subset=["r"])
            if known.empty:
                rows.append([str(task), name, *[""] * 9])
            else:
                rows.append([str(task), name, code(known.iloc[0]["metric"]), *correlation(known.iloc[0])])
    return lines(["task", "block", "metric", *CORRELATION], rows)


def within(games: analysis.Games) -> str:
    """The same for deviations from each player's mean in a task, over players in whose games both values differ."""
    rows = []
    for task, own in games.episodes.groupby("task"):
        found = [pair for metric in TWELVE if (pair := _within(own, metric))]
        qs = benjamini_hochberg(pd.Series([p for _, _, p, _, _ in found]).to_numpy(float))
        best = sorted(zip(found, qs, strict=True), key=lambda pair: -abs(pair[0][1]))
        for name, words in (("physical", False), ("communication", True)):
            chosen = next((pair for pair in best if (pair[0][0] in COMMUNICATION) == words), None)
            if chosen is None:
                rows.append([str(task), name, *[""] * 6])
                continue
            (metric, r, p, players, n), q = chosen
            rows.append([str(task), name, code(metric), number(r, 3), chance(p), chance(q), str(players), str(n)])
    return lines(["task", "block", "metric", "r", "p", "q", "players", "n"], rows)


def _within(episodes: pd.DataFrame, metric: str) -> tuple[str, float, float, int, int] | None:
    known = episodes[["model", metric, "score"]].dropna()
    kept = known.groupby("model").filter(
        lambda own: not (is_constant(own[metric].to_numpy()) or is_constant(own["score"].to_numpy()))
    )
    if kept.empty:
        return None
    values = kept.groupby("model")[[metric, "score"]].transform(lambda own: own - own.mean())
    players, n = kept["model"].nunique(), len(kept)
    r = float(values[metric].corr(values["score"]))
    free = n - players - 1
    p = 2 * stats.t.sf(abs(r) * (free / (1 - r * r)) ** 0.5, free)
    return metric, r, float(p), players, n


def between(games: analysis.Games) -> str:
    """The share of the score's variance that is between players."""
    rows = []
    for task, own in games.episodes.groupby("task"):
        mean = own.groupby("model")["score"].transform("mean")
        speaking = own.loc[own["message_length"].notna(), "model"].unique()
        share = 1 - ((own["score"] - mean) ** 2).sum() / ((own["score"] - own["score"].mean()) ** 2).sum()
        names = ", ".join(code(name) for name in sorted(speaking))
        rows.append([str(task), str(own["model"].nunique()), names, str(len(own)), number(share, 3)])
    return lines(["task", "players", "of them speak", "games", "share of the variance that is between players"], rows)


def shares(table: pd.DataFrame) -> str:
    rows = [
        [
            str(row["task"]),
            str(row["block"]),
            f"{row['metrics']:.0f}",
            number(row["r2"], 3),
            number(row["adjusted"], 3),
            outside(row["left_out"]),
            number(row["share"], 3),
            chance(row["f_p"]),
            number(row["r2_both"], 3),
            outside(row["left_out_both"]),
            f"{row['n']:.0f}",
        ]
        for _, row in table.dropna(subset=["block"]).iterrows()
    ]
    headings = [
        "task",
        "block",
        "metrics",
        "R²",
        "adjusted",
        "left out",
        "share",
        "p of F",
        "R² of both",
        "left out",
        "n",
    ]
    return lines(headings, rows)


def listed(table: pd.DataFrame, *keys: str) -> str:
    rows = [
        [*(str(row["task"]) if key == "task" else code(row[key]) for key in keys), *correlation(row)]
        for _, row in table.iterrows()
    ]
    return lines([*keys, *CORRELATION], rows)


def converging(table: pd.DataFrame) -> str:
    rows = [
        [
            code(row["model"]),
            code(row["metric"]),
            number(row["r"], 3),
            chance(row["p"]),
            interval(row["low"], row["high"]),
            number(row["spearman"]),
            str(row["n"]),
        ]
        for _, row in table.iterrows()
    ]
    return lines(["player", "metric", "r", "p", "interval", "Spearman", "n"], rows)


def attributed(table: pd.DataFrame) -> str:
    rows = []
    for (task, model), own in table.groupby(["task", "model"], sort=False):
        first, blocks = own.iloc[0], own.set_index("block")
        if pd.isna(first["f1"]):
            rows.append([str(task), code(model), *[""] * 6, str(first["note"])])
            continue
        importance = [
            ""
            if pd.isna(blocks.loc[name, "importance"])
            else f"{number(blocks.loc[name, 'importance'], 3)} ± {number(blocks.loc[name, 'deviation'], 3)}"
            for name in ("others", "own", "observation")
        ]
        guesses = [number(first[name], 3) for name in ("f1", "guess_most", "guess_draw")]
        rows.append(
            [str(task), code(model), *guesses, *importance, "" if pd.isna(first["note"]) else str(first["note"])]
        )
    return lines(["task", "player", "F1", "most frequent", "guessing", "others", "own", "observation", "note"], rows)


def words(table: pd.DataFrame) -> str:
    rows = [
        [
            str(task),
            code(model),
            ", ".join(f"`{word}` ({count})" for word, count in zip(own["word"], own["count"], strict=True)),
        ]
        for (task, model), own in table.groupby(["task", "model"])
    ]
    return lines(["task", "player", "words (uses)"], rows)


def without_messages(games: analysis.Games, speaking: str, silent: str) -> str:
    """A player compared with itself without messages, layout by layout."""
    wide = games.episodes[games.episodes["model"].isin([speaking, silent])].pivot(
        index="seed", columns="model", values="score"
    )
    found = stats.ttest_rel(wide[speaking], wide[silent])
    ends = found.confidence_interval()
    row = [
        f"{number(wide[speaking].mean())} ± {number(wide[speaking].std(ddof=0))}",
        f"{number(wide[silent].mean())} ± {number(wide[silent].std(ddof=0))}",
        number((wide[speaking] - wide[silent]).mean()),
        interval(ends.low, ends.high),
        chance(found.pvalue),
        str(len(wide)),
    ]
    return lines([code(speaking), code(silent), "difference", "interval", "p (paired t)", "n"], [row])


def edits(table: pd.DataFrame) -> str:
    rows = []
    for (by, group), own in table.groupby(["by", "group"], sort=False):
        units = own.set_index("over")
        cells = []
        for over in ("rounds", "rounds with several texts", "games"):
            if over not in units.index:
                cells += ["", "", "0"]
                continue
            unit = units.loc[over]
            cells += [number(unit["spearman"]), number(unit["pearson"]), f"{unit['n']:,}"]
        name = {"all": "all", "digits": f"digits {group}"}.get(str(by), str(group) if by == "task" else code(group))
        rows.append([name, *cells])
    return lines(["", "ρ, rounds", "r", "n", "ρ, several texts", "r", "n", "ρ, games", "r", "n"], rows)


ABOUT_EDITS = (
    "560 games: the seven built-in players that speak, on the layouts 0 to 79. ρ is Spearman's rank correlation, r\n"
    "Pearson's, n the number of rounds or of games (means over their rounds)."
)


def main(folder: Path) -> None:
    games, spoken = analysis.load(folder / "games"), analysis.load(folder / "spoken")
    speaking = games.episodes.loc[games.episodes["message_length"].notna(), "model"].unique().tolist()
    attribution = pd.read_csv(folder / "report" / "tables" / "attribution.csv")
    tables = {
        "players": between(games),
        "top metrics": tops(analysis.correlations(games)),
        "within players": within(games),
        "silence as zero": shares(analysis.blocks(games, definition="toolkit")),
        "those who speak": shares(analysis.blocks(games.where(model=speaking))),
        "failure modes": listed(analysis.failure_modes(games), "task", "metric"),
        "convergence": listed(analysis.convergence_by_task(games).dropna(subset=["r"]), "task", "metric"),
        "convergence of players": converging(analysis.convergence_by_model(games).dropna(subset=["r"])),
        "attribution": attributed(attribution),
        "without messages": without_messages(games, "built-in/map-and-carry", "built-in/map-in-silence"),
        "keywords": words(analysis.keywords(games)),
    }
    for name, table in tables.items():
        put("insight.md", name, table)
    measured("embedders", "`hash-1` and edit similarity", f"{ABOUT_EDITS}\n\n{edits(analysis.relate_to_edits(spoken))}")
    figures = {
        "blocks": analysis.plot_blocks(analysis.blocks(games, definition="toolkit")),
        "attribution": analysis.plot_attribution(attribution),
    }
    for name, figure in figures.items():
        analysis.save(figure, PAGES / "insight" / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
