"""Prints the page `losses` of docs/measured; see `.ci/losses`."""

import json
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from swarmseat import analysis

SHORT = re.compile("^built-in/")
KINDS = ["moved", "blocked", "waited", "switched", "invalid", "late"]
# Metrics whose relation to the accuracy is shown: how agents moved, and how they stood.
METRICS = ["blocked_share", "stillness", "step_length", "pushes", "separation", "polarization", "message_length"]


def number(value: float, digits: int = 2) -> str:
    return "" if pd.isna(value) else f"{round(value, digits) + 0.0:.{digits}f}"


def lines(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; the first two columns are text."""
    marks = ["---", "---", *["---:"] * (len(headings) - 2)]
    return "".join(f"| {' | '.join(row)} |\n" for row in [headings, marks, *rows])


def games(folder: Path) -> pd.DataFrame:
    """A row for each game: its metrics, its worth, and what decisions of each kind lost."""
    rows = []
    for file in sorted((folder / "worths").glob("run_*.json")):
        for worth in json.loads(file.read_text()):
            lost = {f"lost_{kind}": worth["kinds"][kind]["lost"] for kind in KINDS}
            number_of = {f"number_{kind}": worth["kinds"][kind]["decisions"] for kind in KINDS}
            gained = sum(kind["gained"] for kind in worth["kinds"].values())
            start = worth["values"][0]
            rows.append(
                {"episode": worth["episode"], "start": start, "share": worth["accuracy"], "gained": gained}
                | {"weak": worth["reference_is_weak"]}
                | lost
                | number_of
            )
    episodes = analysis.load(folder / "games").episodes
    return episodes.merge(pd.DataFrame(rows), on="episode")


def accuracies(all_games: pd.DataFrame) -> str:
    rows = []
    for (task, model), own in all_games.groupby(["task", "model"]):
        shown = [number(own[column].mean()) for column in ("start", "score", "share")]
        spread = number(own["share"].std(ddof=0))
        rows.append([str(task), name(model), *shown, spread, str(int(own["weak"].sum())), str(len(own))])
    headings = ["task", "player", "could be scored", "score", "accuracy", "deviation", "reference weak", "games"]
    return lines(headings, rows)


def name(model: object) -> str:
    return f"`{SHORT.sub('', str(model))}`"


def kinds(all_games: pd.DataFrame) -> str:
    """The share of each kind of decision in all that seats lost, and in the number of decisions."""
    rows = []
    for (task, model), own in all_games.groupby(["task", "model"]):
        lost = [own[f"lost_{kind}"].sum() for kind in KINDS]
        counts = [own[f"number_{kind}"].sum() for kind in KINDS]
        if sum(lost) == 0:
            continue
        cells = [
            f"{100 * part / sum(lost):.0f} % of {100 * count / sum(counts):.0f} %" if count else ""
            for part, count in zip(lost, counts, strict=True)
        ]
        rows.append([str(task), name(model), number(sum(lost) / len(own), 1), number(own["gained"].mean(), 1), *cells])
    return lines(["task", "player", "lost", "gained", *KINDS], rows)


def relations(all_games: pd.DataFrame) -> str:
    """Spearman's correlation of the accuracy with metrics, with an interval that draws players."""
    rows = []
    for task, own in all_games.groupby("task"):
        for metric in METRICS:
            if metric not in own or own[[metric, "share"]].dropna()[metric].nunique() < 3:
                continue
            known = own[["model", metric, "share"]].dropna()
            # With fewer players most draws are of one player alone.
            if known["model"].nunique() < 3:
                continue
            rho = known[metric].corr(known["share"], method="spearman")
            low, high = drawn(known, metric)
            rows.append(
                [
                    str(task),
                    f"`{metric}`",
                    number(rho),
                    f"{number(low)} to {number(high)}",
                    str(known["model"].nunique()),
                    str(len(known)),
                ]
            )
    return lines(["task", "metric", "ρ", "interval", "players", "games"], rows)


def drawn(known: pd.DataFrame, metric: str, draws: int = 2000) -> tuple[float, float]:
    """The 95 % interval of ρ over draws of players with all their games."""
    players = sorted(known["model"].unique())
    of = {player: known[known["model"] == player] for player in players}
    generator = pd.Series(range(draws)).sample(frac=1, random_state=1)
    found = []
    for draw in generator:
        chosen = pd.Series(players).sample(len(players), replace=True, random_state=int(draw))
        sample = pd.concat([of[player] for player in chosen])
        found.append(sample[metric].corr(sample["share"], method="spearman"))
    values = pd.Series(found).dropna()
    return float(values.quantile(0.025)), float(values.quantile(0.975))


def main(folder: Path) -> None:
    all_games = games(folder)
    sections = {
        "What could be scored": (
            "Means over the games. *Reference weak*: the number of games that scored more than the reference would have.",
            accuracies(all_games),
        ),
        "What decisions lost": (
            "Sums of the losses of seats above 0 in a game (*lost*) and below 0 (*gained*). By kind of decision: its share in what was "
            "lost, *of* its share in the number of decisions.",
            kinds(all_games),
        ),
        "Accuracy and metrics": (
            "Spearman's rank correlation over the games of a task, of metrics that three players or more have. The interval draws players "
            "with all their games.",
            relations(all_games),
        ),
    }
    for title, (text, table) in sections.items():
        print(f"\n## {title}\n\n{text}\n\n{table}", end="")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
