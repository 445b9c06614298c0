"""Compares `hash-1` with a sentence model, on sentences and on games; see `.ci/embedder`. Prints Markdown, and fails if the model
does not know the meanings of sentences."""

import sys
from itertools import combinations, product
from pathlib import Path

import numpy as np
from sentence_transformers import SentenceTransformer

from swarmseat import analysis
from swarmseat.analysis.texts import Embedder

# Messages of a swarm, in four wordings of each meaning. Wordings of one meaning share few words; meanings share many.
MEANINGS = {
    "the prey is in the north": [
        "The prey is at the top of my view.",
        "I see the target up north of me.",
        "Our quarry stands above me, hunt it there.",
        "Prey spotted in the upper rows.",
    ],
    "the prey is in the south": [
        "The prey is at the bottom of my view.",
        "I see the target down south of me.",
        "Our quarry stands below me, hunt it there.",
        "Prey spotted in the lower rows.",
    ],
    "switch the light": [
        "Everybody switch your light next round.",
        "All of us should toggle lamps now.",
        "Flip your bulb in the coming turn.",
        "Let us change the state of our lights together.",
    ],
    "do not switch the light": [
        "Nobody switch your light next round.",
        "All of us should leave the lamps as they are.",
        "Keep your bulb unchanged in the coming turn.",
        "Let us not touch the state of our lights.",
    ],
    "I carry food": [
        "I have picked up food and walk to the nest.",
        "Carrying a meal home now.",
        "My hands are full, heading back to base with supplies.",
        "Got something to eat, returning to the colony.",
    ],
    "I need help to push": [
        "The box is too heavy, come and push with me.",
        "Help me shove this obstacle, I am too weak alone.",
        "I need more hands at the crate to move it.",
        "Join my side of the block and apply force.",
    ],
    "a wall is in the way": [
        "There is a wall here, walk around it.",
        "My path is blocked, take another route.",
        "Dead end ahead, go the other way.",
        "An obstacle stops us here, make a detour.",
    ],
    "I do not know where to go": [
        "I see nothing, where should I go?",
        "No idea which direction to take, please advise.",
        "I am lost, somebody tell me the way.",
        "Nothing in my window, any suggestions for a move?",
    ],
}


def cosines(embedder: Embedder) -> tuple[np.ndarray, np.ndarray]:
    """Cosines of the pairs of wordings of one meaning, and of the pairs of different meanings."""
    texts = [text for wordings in MEANINGS.values() for text in wordings]
    meanings = [meaning for meaning, wordings in MEANINGS.items() for _ in wordings]
    vectors = embedder.vectors(texts)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-6)
    pairs = list(combinations(range(len(texts)), 2))
    alike = [float(vectors[a] @ vectors[b]) for a, b in pairs]
    same = np.array([meanings[a] == meanings[b] for a, b in pairs])
    return np.array(alike)[same], np.array(alike)[~same]


def right_order(same: np.ndarray, other: np.ndarray) -> float:
    """The share of two pairs, one of each kind, of which that of one meaning has the larger cosine."""
    return float(np.mean([(a > b) + (a == b) / 2 for a, b in product(same, other)]))


def row(*cells: object) -> str:
    return f"| {' | '.join(f'{cell:.2f}' if isinstance(cell, float) else str(cell) for cell in cells)} |"


def cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.2f}"


games_folder, weights = sys.argv[1:]
model = analysis.SentenceTransformers("all-MiniLM-L6-v2", SentenceTransformer(weights, device="cpu"))
embedders = [analysis.Hash1(), model]

print(f"The model is all-MiniLM-L6-v2 (`{model.id}`), {Path(weights, 'model.safetensors').stat().st_size / 1e6:.0f} MB.\n")
print("## Sentences\n")
print(
    f"{len(MEANINGS)} meanings in four wordings each. *Right order*: the share of two pairs of sentences, one pair of one meaning and"
    "\none of two meanings, of which the former has the larger cosine; 0.5 is chance.\n"
)
print("| embedder | mean cosine, one meaning | mean cosine, two meanings | right order |\n| --- | ---: | ---: | ---: |")
orders = []
for embedder in embedders:
    same, other = cosines(embedder)
    orders.append(right_order(same, other))
    print(row(f"`{embedder.id}`", same.mean(), other.mean(), orders[-1]))

loaded = analysis.load(games_folder)
acts = loaded.table("acts", ["round", "message"])
own = loaded.episodes[["episode", "model"]]
tables = [analysis.homogeneity(acts, embedder).merge(own, on="episode") for embedder in embedders]
# Where all agents say the same, both values are 1 by definition.
several = [table[table["homogeneity"] < 1] for table in tables]
games = loaded.episodes["episode"].nunique()
print("\n## Games\n")
print(
    f"{games} games of the built-in players that speak, seeds 0 to 2 of each task, rounds with several texts. Spearman's ρ is over these rounds.\n"
)
print("| player | rounds | mean by `hash-1` | mean by the model | ρ |\n| --- | ---: | ---: | ---: | ---: |")
for name in sorted(several[0]["model"].unique()):
    by_hash, by_model = (table[table["model"] == name] for table in several)
    try:
        rho = analysis.compare_embedders(by_hash, by_model)["spearman"]
    except analysis.TooLittleDataError:
        rho = float("nan")
    shown = [cell(float(table["homogeneity"].mean())) for table in (by_hash, by_model)]
    print(row(f"`{name.removeprefix('built-in/')}`", len(by_hash), *shown, cell(rho)))
everything = analysis.compare_embedders(*several)
shown = [cell(float(table["homogeneity"].mean())) for table in several]
print(row("all", everything["n"], *shown, cell(everything["spearman"])))

assert orders[1] > 0.85, f"the model does not know what sentences mean: {orders}"  # noqa: S101
assert orders[1] > orders[0], orders  # noqa: S101
