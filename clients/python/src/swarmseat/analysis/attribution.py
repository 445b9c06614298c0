"""Attribution of an agent's next action to others' messages, to its own last act, or to its observation.

A random forest predicts actions. The importance of a block of inputs is the fall of the forest's F1 when the rows of
the block are permuted together.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.decomposition import PCA
from sklearn.ensemble import RandomForestClassifier
from sklearn.metrics import f1_score
from sklearn.model_selection import GroupKFold

from .problems import FilesError, TooLittleDataError
from .statistics import Floats, Names
from .tables import HOW_TO_EXPORT, Games
from .texts import Embedder, Hash1, mean_vectors
from .views import encode_views, maps_of, own_marks, seats_of, windows

TREES = 300
FOLDS = 5
REPEATS = 10
DIMENSIONS_MAX = 64
"""The number of dimensions to which vectors are reduced, so that no block is wider than another."""

ACTS_MAX = 20_000
"""The default maximum number of acts of a model in a task; they are drawn from all."""


@dataclass(frozen=True)
class Block:
    """Inputs that are permuted together.

    Attributes:
        vectors: Numbers that are reduced by principal components of the training part.
        numbers: Numbers that are used as they are.
    """

    vectors: Floats
    numbers: Floats


@dataclass(frozen=True)
class Attribution:
    """The result of an attribution.

    Attributes:
        f1: Macro F1 over the actions that occur, of predictions for games that were not trained on.
        guess_most: F1 of always guessing the most frequent action.
        guess_draw: Mean F1 of guessing at random with the frequencies of actions.
        guess_deviation: The deviation of this F1.
        importance: The fall of F1 when a block is permuted, mean and deviation over the repeats.
        alone: F1 of each block alone.
    """

    f1: float
    guess_most: float
    guess_draw: float
    guess_deviation: float
    importance: Mapping[str, tuple[float, float]]
    alone: Mapping[str, float]

    @property
    def has_model(self) -> bool:
        """Whether the forest is better than guessing; if not, importances mean nothing."""
        return self.f1 > max(self.guess_most, self.guess_draw + 2 * self.guess_deviation)


def action_attribution(
    games: Games,
    *,
    observation: Literal["grid", "text"] = "grid",
    embedder: Embedder | None = None,
    trees: int = TREES,
    repeats: int = REPEATS,
    acts: int = ACTS_MAX,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Attributes actions to blocks of inputs, for each task and model.

    The function needs the tables `acts`, `heard` and `rounds`. Without a table `views`, windows are rebuilt exactly
    from the maps of `rounds`.

    Args:
        games: The games, at least two for each task and model.
        observation: `grid` for the cells of the window, `text` for the vector of its text (needs the table `views`).
        embedder: The embedder that makes vectors of texts. Default: `hash-1`.
        trees: The number of trees of a forest.
        repeats: The number of permutations of a block.
        acts: The maximum number of acts of a model in a task, drawn from all games; fewer are faster.
        seed: The seed of all draws.
        progress: A function that gets a line before each forest.

    Returns:
        A row for each task, model and block (`others`, `own`, `observation`): `games`, `samples`, `f1`, `guess_most`,
        `guess_draw`, `importance`, `deviation`, `alone`, `note`. Where the forest is no better than guessing the
        importance is missing and the note is `no model`.

    Raises:
        FilesError: A table is missing.
        MixedSettingsError: Games have different settings.
    """
    games.one_setting()
    rows: list[dict[str, Any]] = []
    for (task, model), own in games.episodes.groupby(["task", "model"]):
        head = {"task": task, "model": model, "games": len(own)}
        progress(f"{task}, {model}")
        try:
            chosen = games.where(task=task, model=model)
            inputs, actions, episodes = samples(chosen, observation, embedder or Hash1(), acts, seed)
            found = attribute(inputs, actions, episodes, trees=trees, repeats=repeats, seed=seed)
        except TooLittleDataError as error:
            rows.append({**head, "note": str(error)})
            continue
        rows += [{**head, "samples": len(actions), **row} for row in _rows(found)]
    return pd.DataFrame(rows)


def _rows(found: Attribution) -> list[dict[str, Any]]:
    shared = {"f1": found.f1, "guess_most": found.guess_most, "guess_draw": found.guess_draw}
    rows = []
    for name, (mean, deviation) in found.importance.items():
        importance = {"importance": mean, "deviation": deviation} if found.has_model else {}
        note = "" if found.has_model else "no model"
        rows.append({**shared, "block": name, **importance, "alone": found.alone[name], "note": note})
    return rows


def attribute(
    blocks: Mapping[str, Block],
    actions: Names,
    episodes: Names,
    *,
    trees: int = TREES,
    repeats: int = REPEATS,
    seed: int = 1,
) -> Attribution:
    """Attributes actions to blocks, with folds of whole episodes.

    Args:
        blocks: Inputs by name, each with a row for each action.
        actions: The actions.
        episodes: The episode of each action.
        trees: The number of trees of a forest.
        repeats: The number of permutations of a block.
        seed: The seed of all draws.

    Raises:
        TooLittleDataError: There are fewer than two episodes or two actions.
    """
    labels = sorted(set(actions))
    if len(labels) < 2:
        raise TooLittleDataError("all agents always do the same, so there is nothing to predict")
    folds = min(FOLDS, len(set(episodes)))
    if folds < 2:
        raise TooLittleDataError("there is one game only, and a forest is tested on games that it was not trained on")
    random = np.random.default_rng(seed)
    names = list(blocks)
    predicted = np.empty_like(actions)
    alone = {name: np.empty_like(actions) for name in names}
    permuted = {name: np.empty((repeats, len(actions)), object) for name in names}
    most, drawn = np.empty_like(actions), np.empty((repeats, len(actions)), object)
    for train, test in GroupKFold(folds).split(actions, groups=episodes):
        parts = {name: _reduced(block, train) for name, block in blocks.items()}
        forest = _forest(trees, seed).fit(np.hstack([part[train] for part in parts.values()]), actions[train])
        shown = {name: part[test] for name, part in parts.items()}
        predicted[test] = forest.predict(np.hstack(list(shown.values())))
        for name in names:
            single = _forest(trees, seed).fit(parts[name][train], actions[train])
            alone[name][test] = single.predict(shown[name])
            # One call predicts all repeats, as each call of a forest has a large fixed cost.
            orders = [random.permutation(len(test)) for _ in range(repeats)]
            shuffled = {other: np.tile(part, (repeats, 1)) for other, part in shown.items()}
            shuffled[name] = shown[name][np.concatenate(orders)]
            answers = forest.predict(np.hstack(list(shuffled.values()))).reshape(repeats, len(test))
            permuted[name][:, test] = answers
        values, counts = np.unique(actions[train].astype(str), return_counts=True)
        most[test] = values[counts.argmax()]
        drawn[:, test] = random.choice(values, (repeats, len(test)), p=counts / counts.sum())

    def f1(answers: Names) -> float:
        return float(
            f1_score(actions.astype(str), answers.astype(str), labels=labels, average="macro", zero_division=0.0)
        )

    full = f1(predicted)
    drops = {name: full - np.array([f1(answers) for answers in permuted[name]]) for name in names}
    guesses = np.array([f1(guess) for guess in drawn])
    return Attribution(
        f1=full,
        guess_most=f1(most),
        guess_draw=float(guesses.mean()),
        guess_deviation=float(guesses.std()),
        importance={name: (float(drop.mean()), float(drop.std())) for name, drop in drops.items()},
        alone={name: f1(answers) for name, answers in alone.items()},
    )


def _forest(trees: int, seed: int) -> RandomForestClassifier:
    return RandomForestClassifier(
        trees, min_samples_leaf=2, max_features="sqrt", class_weight="balanced", random_state=seed, n_jobs=-1
    )


def _reduced(block: Block, train: NDArray[np.int64]) -> Floats:
    vectors = block.vectors
    if min(len(train), vectors.shape[1]) > DIMENSIONS_MAX:
        # Both solvers are exact, and each is fast where the other is slow.
        few = len(train) <= vectors.shape[1]
        components = PCA(DIMENSIONS_MAX, svd_solver="full" if few else "covariance_eigh").fit(vectors[train])
        vectors = components.transform(vectors)
    return np.hstack([vectors, block.numbers]).astype(np.float32)


def samples(
    games: Games, observation: Literal["grid", "text"], embedder: Embedder, most: int = ACTS_MAX, seed: int = 1
) -> tuple[dict[str, Block], Names, Names]:
    """The inputs by block, the actions and the episodes of the acts of one model in one task.

    Raises:
        FilesError: A table is missing.
        TooLittleDataError: No agent did anything.
    """
    if not games.has("heard"):
        raise FilesError(f"{games.source} has no table 'heard', so it is not known who heard what: {HOW_TO_EXPORT}")
    acts = games.table("acts", ["round", "agent", "i", "j", "action", "message"])
    chosen = acts[acts["action"].notna() & acts["i"].notna()].reset_index(drop=True)
    if chosen.empty:
        raise TooLittleDataError("no agent did anything in these games")
    if len(chosen) > most:
        chosen = chosen.sample(most, random_state=seed).sort_index().reset_index(drop=True)
    sizes = games.episodes[["episode", "task", "rules", "control", "view_size", "max_round"]]
    chosen = chosen.merge(sizes, on="episode", how="left", validate="many_to_one")
    blocks = {
        "others": _others(games, chosen, embedder),
        "own": _own(acts, chosen, embedder),
        "observation": _observation(games, chosen, observation, embedder),
    }
    return blocks, chosen["action"].to_numpy(object), chosen["episode"].to_numpy(object)


_KEYS = ["episode", "round", "agent"]


def _others(games: Games, chosen: pd.DataFrame, embedder: Embedder) -> Block:
    heard = games.table("heard", ["round", "receiver", "message", "own"]).rename(columns={"receiver": "agent"})
    heard = heard[heard["own"].ne(True) & heard["message"].notna()]
    placed = chosen[_KEYS].assign(row=np.arange(len(chosen))).merge(heard, on=_KEYS)
    rows = placed["row"].to_numpy(np.int64)
    counts = np.bincount(rows, minlength=len(chosen)).astype(float)
    return Block(mean_vectors(placed["message"], rows, len(chosen), embedder), counts[:, None])


def _own(acts: pd.DataFrame, chosen: pd.DataFrame, embedder: Embedder) -> Block:
    before = acts[[*_KEYS, "action", "message"]].assign(round=acts["round"] + 1)
    last = chosen[_KEYS].merge(before, on=_KEYS, how="left", validate="one_to_one")
    said = np.flatnonzero(last["message"].notna())
    vectors = mean_vectors(last["message"].iloc[said], said, len(last), embedder)
    return Block(vectors, pd.get_dummies(last["action"].fillna("none")).to_numpy(float))


def _observation(games: Games, chosen: pd.DataFrame, kind: Literal["grid", "text"], embedder: Embedder) -> Block:
    maps = maps_of(games.table("rounds", ["round", "grid"]))
    seats = seats_of(chosen)
    progress = (chosen["round"] / chosen["max_round"]).to_numpy(float)
    numbers = np.column_stack([own_marks(seats, maps).astype(float), progress])
    if not games.has("views"):
        if kind == "text":
            raise FilesError(
                f"{games.source} has no table 'views', whose texts are asked for: export it, or take observation='grid'"
            )
        return Block(windows(seats, maps), numbers)
    texts = (
        chosen[_KEYS].merge(games.table("views", ["round", "agent", "view"]), on=_KEYS, how="left")["view"].fillna("")
    )
    if kind == "text":
        return Block(mean_vectors(texts, np.arange(len(texts)), len(texts), embedder), numbers)
    return Block(encode_views(texts, chosen["agent"]), numbers)
