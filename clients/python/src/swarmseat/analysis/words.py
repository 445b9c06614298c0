"""The words that models use, and the words that distinguish models."""

import unicodedata
from collections import Counter

import numpy as np
import pandas as pd

from .problems import TooLittleDataError
from .statistics import Floats
from .stopwords import STOP_WORDS
from .tables import Games

TOP = 10
"""The number of words that are shown for each model and task."""

WORDS_COMPARED_MIN = 2

PRIOR_WORDS = 1000.0
"""The weight of the prior: each model gets as many prior words of the task as all models wrote together."""


class _Spaces(dict[int, str]):
    """Turns punctuation and symbols into spaces; a character is classified when it first occurs."""

    def __missing__(self, code: int) -> str:
        character = chr(code)
        self[code] = " " if unicodedata.category(character)[0] in "PS" else character
        return self[code]


_SPACES = _Spaces()


def words_of(text: str) -> list[str]:
    """The words of a message in lower case, stop words and numbers included."""
    return text.lower().translate(_SPACES).split()


def is_keyword(word: str) -> bool:
    """Whether the word has a letter and is no stop word."""
    return word not in STOP_WORDS and any(character.isalpha() for character in word)


def keywords(games: Games, top: int = TOP) -> pd.DataFrame:
    """The most frequent keywords in the messages that agents sent, for each task and model.

    Returns:
        `task`, `model`, `word`, `count`, `per_1000_words` (of all words, stop words included), `share` of
        messages with the word; the most frequent first, equal ones by word.

    Raises:
        TooLittleDataError: No message was sent.
    """
    rows = []
    for (task, model), texts in _messages(games).items():
        counts, total, having = Counter[str](), 0, Counter[str]()
        for text in texts:
            words = words_of(text)
            total += len(words)
            found = list(filter(is_keyword, words))
            counts.update(found)
            having.update(set(found))
        rows += [
            {
                "task": task,
                "model": model,
                "word": word,
                "count": counts[word],
                "per_1000_words": 1000 * counts[word] / total,
                "share": having[word] / len(texts),
            }
            for word in sorted(counts, key=lambda word: (-counts[word], word))[:top]
        ]
    return pd.DataFrame(rows, columns=["task", "model", "word", "count", "per_1000_words", "share"])


def distinctive_words(games: Games, top: int = TOP) -> pd.DataFrame:
    """The keywords that best distinguish a model from the other models of its task.

    Log-odds with an informative Dirichlet prior (Monroe, Colaresi and Quinn 2008); the prior is the frequency of the
    word in all models of the task.

    Returns:
        `task`, `model`, `word`, `count`, `others` (its count in the other models), `log_odds`, `z`; the largest z
        first.

    Raises:
        TooLittleDataError: No message was sent, or only one model sent messages in each task.
    """
    counts: dict[str, dict[str, Counter[str]]] = {}
    for (task, model), texts in _messages(games).items():
        found = Counter(word for text in texts for word in words_of(text) if is_keyword(word))
        counts.setdefault(task, {})[model] = found
    tables = []
    for task, models in counts.items():
        if len(models) > 1:
            everything = sum(models.values(), Counter[str]())
            for model, own in models.items():
                table = log_odds(own, everything - own)
                table = table[table["z"] > 0].head(top)
                tables.append(table.assign(task=task, model=model))
    if not tables:
        raise TooLittleDataError(
            "distinctive words need messages of two models in one task: add games of another model"
        )
    return pd.concat(tables, ignore_index=True)[["task", "model", "word", "count", "others", "log_odds", "z"]]


def log_odds(own: Counter[str], others: Counter[str], prior_words: float = PRIOR_WORDS) -> pd.DataFrame:
    """Compares two counts of words: `word`, `count`, `others`, `log_odds`, `z`; the largest z first, then by word."""
    words = sorted(own.keys() | others.keys())
    a = np.array([own[word] for word in words], float)
    b = np.array([others[word] for word in words], float)
    prior = prior_words * (a + b) / max(float((a + b).sum()), 1.0)

    if len(words) < WORDS_COMPARED_MIN:
        # The odds of the only word are infinite on both sides.
        return pd.DataFrame(columns=["word", "count", "others", "log_odds", "z"])
    difference = _log_odds(a + prior) - _log_odds(b + prior)
    z = difference / np.sqrt(1 / (a + prior) + 1 / (b + prior))
    table = pd.DataFrame(
        {"word": words, "count": a.astype(int), "others": b.astype(int), "log_odds": difference, "z": z}
    )
    return table.sort_values("z", ascending=False, kind="stable", ignore_index=True)


def _log_odds(counts: Floats) -> Floats:
    odds: Floats = np.log(counts) - np.log(counts.sum() - counts)
    return odds


def _messages(games: Games) -> dict[tuple[str, str], list[str]]:
    acts = games.table("acts", ["task", "model", "message"]).dropna(subset=["message"])
    acts = acts[acts["message"] != ""]
    if acts.empty:
        raise TooLittleDataError(
            "no message was sent in these games, so there are no words: play with models that talk"
        )
    return {(str(task), str(model)): own["message"].tolist() for (task, model), own in acts.groupby(["task", "model"])}
