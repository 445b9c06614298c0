"""Prints docs/measured/insight.md, and draws two figures of docs/evaluate/insight.md; see `.ci/insight`."""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from scipy import stats

from swarmseat import analysis
from swarmseat.analysis.metrics import COMMUNICATION, TWELVE
from swarmseat.analysis.statistics import benjamini_hochberg, is_constant

DOCS = Path(__file__).resolve().parent.parent / "docs"
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


SECTIONS = {
    "The sample": """
480 games: 24 pairs of a task and a player, on the layouts 0 to 19 in the standard setting (12 agents, 10 × 10 cells, windows of 5 × 5,
100 rounds, decentralized, rules `paper`), with another player seed for each layout.
""",
    "Correlations": """
The metric with the largest |r| with the score of each task, among the eight physical metrics and among the four of
communication. q is over the twelve of the task. The interval is Fisher's; *by models* is that of a bootstrap that draws players with
all their games, which needs five of them.
""",
    "Correlations within players": """
The same if the mean of each player is taken from its metrics and its scores. Players in whose games the metric or the score never
changes are left out; p counts a degree of freedom for each player.
""",
    "Physical metrics against communication": """
R² of each block alone, its Shapley share of the R² of both, and the F test of the block given the other. *Left out* is R² for the
games of players that were left out of the fit, first of the block, then of both. By the definition `toolkit`, where a silent game has
zeros:
""",
    "The same for players that speak": """
By the definition `paper`.
""",
    "Failure modes": """
The paper's explanations of failures, each in its task. It reports r = -0.668 (Pursuit), -0.185 (Synchronization) and -0.309
(Foraging) over language models. q is over the table.
""",
    "Convergence": """
Whether games in which messages become more alike score more.
""",
    "Convergence by player": """
The same over the games of a player.
""",
    "Attribution of actions": """
A random forest predicts each next action from others' messages, the agent's own last act and message, and what it sees. An
importance is by how much its F1 falls where a block is permuted. 4,000 acts of each player, drawn from all 20 games; 300 trees, five
folds of whole games, 10 permutations.
""",
    "A player with and without messages": """
`map-in-silence` is `map-and-carry` without messages. On the same layouts, with the same player seeds:
""",
    "Keywords": """
Words without stop words and numbers.
""",
    "hash-1 and edit similarity": """
560 games: the seven built-in players that speak, on the layouts 0 to 79. ρ is Spearman's rank correlation of homogeneity and edit
consistency, r Pearson's, n the number of rounds or of games (means over their rounds).
""",
}
"""What each table shows, by the heading of its section."""


HEAD = """Metrics of revision {revision}, text vectors of `{embedder}`.
"""


def show(games: analysis.Games, tables: Sequence[str]) -> None:
    """Prints the tables in the order of `SECTIONS`."""
    first = games.episodes.iloc[0]
    print(HEAD.format(revision=first["metrics_revision"], embedder=first["embedder"]), end="")
    for (title, text), table in zip(SECTIONS.items(), tables, strict=True):
        print(f"\n## {title}\n{text}\n{table}", end="")


def main(folder: Path) -> None:
    games, spoken = analysis.load(folder / "games"), analysis.load(folder / "spoken")
    speaking = games.episodes.loc[games.episodes["message_length"].notna(), "model"].unique().tolist()
    attribution = pd.read_csv(folder / "report" / "tables" / "attribution.csv")
    tables = [
        between(games),
        tops(analysis.correlations(games)),
        within(games),
        shares(analysis.blocks(games, definition="toolkit")),
        shares(analysis.blocks(games.where(model=speaking))),
        listed(analysis.failure_modes(games), "task", "metric"),
        listed(analysis.convergence_by_task(games).dropna(subset=["r"]), "task", "metric"),
        converging(analysis.convergence_by_model(games).dropna(subset=["r"])),
        attributed(attribution),
        without_messages(games, "built-in/map-and-carry", "built-in/map-in-silence"),
        words(analysis.keywords(games)),
        edits(analysis.relate_to_edits(spoken)),
    ]
    show(games, tables)
    figures = {
        "blocks": analysis.plot_blocks(analysis.blocks(games, definition="toolkit")),
        "attribution": analysis.plot_attribution(attribution),
    }
    for name, figure in figures.items():
        analysis.save(figure, DOCS / "evaluate" / "insight" / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
