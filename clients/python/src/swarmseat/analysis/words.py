"""The words that models use."""

import unicodedata
from collections import Counter

import pandas as pd

from .problems import TooLittleDataError
from .stopwords import STOP_WORDS
from .tables import Games

TOP = 10
"""The number of words that are shown for each model and task."""


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


def _messages(games: Games) -> dict[tuple[str, str], list[str]]:
    acts = games.table("acts", ["task", "model", "message"]).dropna(subset=["message"])
    acts = acts[acts["message"] != ""]
    if acts.empty:
        raise TooLittleDataError(
            "no message was sent in these games, so there are no words: play with models that talk"
        )
    return {(str(task), str(model)): own["message"].tolist() for (task, model), own in acts.groupby(["task", "model"])}
