"""Text vectors, and the homogeneity of the messages of a round."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import sparse, stats

from .problems import MissingColumnsError, MixedMeasuresError, TooLittleDataError
from .statistics import Floats, is_constant
from .tables import Games

DIMENSIONS = 1024

CACHE_TEXTS_MAX = 65_536
"""The maximum number of cached vectors of `hash-1`; messages repeat themselves."""

ROUNDS_COMPARED_MIN = 3

_DIGITS = re.compile(r"\d+")


class Embedder(Protocol):
    """Makes vectors of length 1 from texts. Values of two embedders are never compared."""

    @property
    def id(self) -> str:
        """The embedder's name, which is stored with each value."""

    def vectors(self, texts: Sequence[str]) -> Floats:
        """The vectors of texts, one row per text."""


class Hash1:
    """`hash-1`: hashed words and letter triples, without a model; the embedder of the server."""

    id = "hash-1"

    def vectors(self, texts: Sequence[str]) -> Floats:
        """The vectors of texts, one row per text."""
        return np.array([hash_1(text) for text in texts]).reshape(len(texts), DIMENSIONS)


class SentenceTransformers:
    """A model of the package sentence-transformers, which has to be installed separately.

    Args:
        model: The name or folder of the model, such as `all-mpnet-base-v2`.
        encoder: A loaded model, or another object with its method `encode`.
    """

    def __init__(self, model: str, encoder: Any = None) -> None:
        self.id = f"sentence-transformers:{model}"
        self._encoder = _sentence_transformer(model) if encoder is None else encoder

    def vectors(self, texts: Sequence[str]) -> Floats:
        """The vectors of texts, one row per text."""
        rows: Floats = np.array(self._encoder.encode(list(texts), show_progress_bar=False), np.float64)
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        rows /= np.where(lengths > 0, lengths, 1.0)
        return rows


def _sentence_transformer(model: str) -> Any:
    try:
        from sentence_transformers import SentenceTransformer  # noqa: PLC0415 - it takes seconds, and few need it
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "this embedder needs the package sentence-transformers: pip install sentence-transformers", name=error.name
        ) from error
    return SentenceTransformer(model)


@lru_cache(CACHE_TEXTS_MAX)
def hash_1(text: str) -> Floats:
    """The vector of `hash-1` for a text: 1,024 numbers of Euclidean length 1."""
    tokens = _tokens(text.lower())
    words = [f"w:{_DIGITS.sub('#', token)}" for token in tokens]
    triples = [f"c:{padded[at : at + 3]}" for token in tokens for padded in (f" {token} ",) for at in range(len(token))]
    vector = np.zeros(DIMENSIONS)
    for feature, count in sorted(Counter(words + triples or [f"r:{text}"]).items()):
        hashed = _fnv_1a(feature.encode())
        vector[hashed % DIMENSIONS] += (-1 if hashed >> 63 else 1) * (1 + math.log(count))
    vector /= np.linalg.norm(vector) or 1.0
    vector.flags.writeable = False
    return vector


def _tokens(text: str) -> list[str]:
    return "".join(character if character.isalnum() else " " for character in text).split()


def _fnv_1a(data: bytes) -> int:
    hashed = 0xCBF29CE484222325
    for byte in data:
        hashed = (hashed ^ byte) * 0x100000001B3 % 2**64
    return hashed


def mean_cosine(vectors: Floats) -> float:
    """The mean cosine of all pairs of rows, which have length 1; NaN for fewer than two."""
    n = len(vectors)
    return float((np.sum(vectors.sum(axis=0) ** 2) - n) / (n * (n - 1))) if n > 1 else float("nan")


def homogeneity(acts: pd.DataFrame, embedder: Embedder) -> pd.DataFrame:
    """The homogeneity of each round's messages for an embedder: the mean cosine of all pairs of distinct messages.

    Args:
        acts: Rows with `episode`, `round` and `message`, as in the table `acts`.
        embedder: The embedder that makes vectors of the messages.

    Returns:
        `episode`, `round` (of the state after the round, as in the table `rounds`), `homogeneity` (NaN for fewer than
        two messages, 1 if all are the same), `messages`, `embedder`.
    """
    said = acts[acts["message"].notna() & (acts["message"] != "")]
    texts = sorted(said["message"].unique())
    vectors = embedder.vectors(texts) if texts else np.empty((0, 1))
    place = {text: at for at, text in enumerate(texts)}
    rows = []
    for (episode, number), messages in acts.assign(message=acts["message"].fillna("")).groupby(["episode", "round"])[
        "message"
    ]:
        heard = [text for text in messages if text]
        distinct = sorted(set(heard))
        alike = mean_cosine(vectors[[place[text] for text in distinct]]) if len(distinct) > 1 else float("nan")
        value = 1.0 if len(heard) > 1 and len(distinct) == 1 else alike
        rows.append((episode, int(str(number)) + 1, value, len(heard), embedder.id))
    return pd.DataFrame(rows, columns=["episode", "round", "homogeneity", "messages", "embedder"])


def homogeneity_of_games(by_round: pd.DataFrame) -> pd.DataFrame:
    """The mean over the rounds of each game: `episode`, `homogeneity`, `homogeneity_rounds`, `embedder`."""
    return (
        by_round.groupby(["episode", "embedder"])["homogeneity"]
        .agg(homogeneity="mean", homogeneity_rounds="count")
        .reset_index()[["episode", "homogeneity", "homogeneity_rounds", "embedder"]]
    )


def compare_embedders(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, Any]:
    """The rank correlation of two embedders over the same rounds (or games).

    Args:
        a: A table of `homogeneity` or `homogeneity_of_games`.
        b: A table of another embedder.

    Returns:
        `embedders`, `n` (pairs), `spearman`, `p`.

    Raises:
        MixedMeasuresError: A table has two embedders, or both have the same.
        TooLittleDataError: The tables have fewer than three different values in common.
    """
    names = [_only_embedder(table) for table in (a, b)]
    if names[0] == names[1]:
        raise MixedMeasuresError(f"both tables are of the embedder {names[0]}: compare it with another one")
    keys = [key for key in ("episode", "round") if key in a and key in b]
    both = a.merge(b, on=keys, suffixes=("_a", "_b")).dropna(subset=["homogeneity_a", "homogeneity_b"])
    rank, p = _ranks(both["homogeneity_a"], both["homogeneity_b"])
    return {"embedders": tuple(names), "n": len(both), "spearman": rank, "p": p}


def _only_embedder(table: pd.DataFrame) -> str:
    names = table["embedder"].unique()
    if len(names) != 1:
        raise MixedMeasuresError(f"a table must have the values of one embedder, and this one has {len(names)}")
    return str(names[0])


DIGITS_FROM = (0.1, 0.3)
BANDS = ("below 10%", "10% to 30%", "from 30%")
"""Bands of the share of digits in messages, for each of which `relate_to_edits` computes a row."""


def relate_to_edits(games: Games) -> pd.DataFrame:
    """The correlation of homogeneity with mean edit similarity: how much of it is mere similarity of spelling.

    Both are read from the export. If all messages of a round are one text, both are 1 by definition; rounds with
    several texts have rows of their own.

    Returns:
        A row for each group of games or rounds and each unit: `by` (`all`, `task`, `model` or `digits`), `group`,
        `over` (`rounds`, `rounds with several texts` or `games`), `games`, `n`, `pearson`, `spearman`, `p` (of the
        rank correlation), `within_games` (the mean of rank correlations over the rounds of single games) and
        `embedder`. Undefined values are missing.

    Raises:
        MissingColumnsError: The games were measured without an embedder.
        TooLittleDataError: Homogeneity or edit similarity is the same in all rounds.
    """
    if "embedder" not in games.episodes:
        raise MissingColumnsError("these games were not measured with an embedder: export them with a newer version")
    rounds = games.table("rounds", ["round", *_ALIKE, "digit_share"]).dropna(subset=list(_ALIKE))
    rounds = rounds.merge(games.episodes[["episode", "task", "model"]], on="episode", validate="many_to_one")
    _ranks(*(rounds[name] for name in _ALIKE))
    units = {
        "rounds": rounds,
        "rounds with several texts": rounds[rounds["edit_consistency"] < 1],
        "games": games.episodes.dropna(subset=list(_ALIKE)),
    }
    rows = []
    for over, values in units.items():
        digits = np.digitize(values["digit_share"], DIGITS_FROM)
        grouped = {
            "all": np.full(len(values), "all"),
            "task": values["task"],
            "model": values["model"],
            "digits": np.array(BANDS)[digits],
        }
        rows += [
            {"by": by, "group": group, "over": over, **_alike(own, single=over != "games")}
            for by, groups in grouped.items()
            for group, own in values.groupby(groups)
        ]
    return pd.DataFrame(rows).assign(embedder=str(games.episodes["embedder"].iloc[0]))


_ALIKE = ("homogeneity", "edit_consistency")


def _alike(values: pd.DataFrame, *, single: bool) -> dict[str, Any]:
    x, y = (values[name].to_numpy(np.float64) for name in _ALIKE)
    known = len(x) >= ROUNDS_COMPARED_MIN and not (is_constant(x) or is_constant(y))
    rank, p = _ranks(values["homogeneity"], values["edit_consistency"]) if known else (math.nan, math.nan)
    own = [_alike(rounds, single=False)["spearman"] for _, rounds in values.groupby("episode")] if single else []
    defined = [value for value in own if not math.isnan(value)]
    return {
        "games": values["episode"].nunique(),
        "n": len(values),
        "pearson": float(np.corrcoef(x, y)[0, 1]) if known else math.nan,
        "spearman": rank,
        "p": p,
        "within_games": float(np.mean(defined)) if defined else math.nan,
    }


def _ranks(a: "pd.Series[float]", b: "pd.Series[float]") -> tuple[float, float]:
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if len(x) < ROUNDS_COMPARED_MIN or is_constant(x) or is_constant(y):
        raise TooLittleDataError(
            f"a rank correlation needs {ROUNDS_COMPARED_MIN} values that differ on both sides, and {len(x)} pairs are "
            "defined: take more rounds with several messages"
        )
    found = stats.spearmanr(x, y)
    return float(found.statistic), float(found.pvalue)


def mean_vectors(texts: Iterable[str], rows: NDArray[np.int64], count: int, embedder: Embedder) -> Floats:
    """The mean vector of the texts of each row, zeros for a row without texts.

    Args:
        texts: Texts.
        rows: The row to which each text belongs.
        count: The number of rows.
        embedder: The embedder that makes vectors.
    """
    listed = list(texts)
    distinct = sorted(set(listed))
    if not distinct:
        return np.zeros((count, 1))
    place = {text: at for at, text in enumerate(distinct)}
    columns = np.array([place[text] for text in listed])
    uses = sparse.csr_array((np.ones(len(listed)), (rows, columns)), shape=(count, len(distinct)))
    totals = np.maximum(np.bincount(rows, minlength=count), 1)
    mean: Floats = (uses @ embedder.vectors(distinct)) / totals[:, None]
    return mean
