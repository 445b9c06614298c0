"""Reads exported tables, and decides which games may be compared."""

import difflib
import json
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.json
import pyarrow.parquet

from ..client import Client
from ..errors import ApiError
from .metrics import Definition, column
from .problems import (
    AnalysisError,
    FilesError,
    MissingColumnsError,
    MixedMeasuresError,
    MixedSettingsError,
    TooLittleDataError,
)

TABLES = ("episodes", "rounds", "acts", "heard", "views")
OPTIONAL_TABLES = frozenset({"heard", "views"})

SETTINGS = (
    "num_agents",
    "width",
    "height",
    "view_size",
    "memory",
    "max_round",
    "noise",
    "max_delay",
    "rules",
    "control",
    "prompt_template",
)
"""The settings in which averaged games must agree."""

REQUIRED = ("episode", "task", "model", "score", "rounds", "reason", *SETTINGS)

LATER_SETTINGS = ("prompt", "answer_reader", "round_deadline_s", "bank_s", "fill_with")
"""Settings that not every export has."""

SAMPLING = ("temperature", "top_p")
"""The settings in which averaged games of one model must agree. They are read from `agent_meta`."""

LINE_BYTES_MAX = 64 * 1024 * 1024
"""The maximum length of a line of a JSON Lines file."""

VALUES_SHOWN_MAX = 5
"""The maximum number of values that an error lists."""

# Without a schema types are guessed from the rows: a message that looks like a time would become one.
_TEXTS = """
    episode run task model rules control models start_mode visibility agent_meta prompt_template prompt answer_reader
    fork_of team team_holders fill_with player status reason journal_head void_reason suite suite_digest embedder source
    failure action message receiver response reasoning grid view
""".split()  # noqa: SIM905 - it is shorter

HOW_TO_EXPORT = "make a complete export with `swarmbench export FOLDER --format parquet --with heard`"


class _Download:
    """The tables of a server in a temporary folder, which is removed with the last `Games` that reads from it."""

    def __init__(self, address: str | Path, token: str | None) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="swarmbench-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        with Client(str(address), token) as client:
            _fetch(client, self.folder)


@dataclass(frozen=True)
class Games:
    """Games that have ended, with their tables.

    Attributes:
        source: The source of the games.
        folders: The folders with the files of the tables.
        episodes: A row for each game, with `temperature` and `top_p` from `agent_meta`.
        left_out: Sentences with the numbers of games that were left out, and the reasons.
    """

    source: str
    folders: tuple[Path, ...]
    episodes: pd.DataFrame
    left_out: tuple[str, ...] = ()
    _downloads: "tuple[_Download, ...]" = field(default=(), repr=False)

    def __len__(self) -> int:
        return len(self.episodes)

    @property
    def tasks(self) -> list[str]:
        """The tasks that were played, by name."""
        return sorted(self.episodes["task"].unique())

    @property
    def models(self) -> list[str]:
        """The models that played, by name."""
        return sorted(self.episodes["model"].unique())

    def has(self, table: str) -> bool:
        """Whether all exports have this table."""
        return all(_file(folder, table) is not None for folder in self.folders)

    def table(self, name: str, columns: Iterable[str] | None = None) -> pd.DataFrame:
        """The rows of a table that belong to these games.

        Args:
            name: One of `TABLES`.
            columns: The needed columns. Default: all.

        Raises:
            FilesError: The file is missing or damaged.
            MissingColumnsError: The table has no such column.
        """
        wanted = None if columns is None else list(dict.fromkeys(["episode", *columns]))
        missing, parts = set(self.episodes["episode"]), []
        for folder in self.folders:
            path = _file(folder, name)
            if path is None:
                raise FilesError(f"{folder} has no table {name!r}: {HOW_TO_EXPORT}")
            rows = _read(path, wanted)
            # A game in two exports is read once.
            parts.append(rows[rows["episode"].isin(missing)])
            missing -= set(rows["episode"])
        return _joined(parts)

    def where(self, **values: Any) -> "Games":
        """The games in which the columns have these values; a list allows several, and None a missing value.

        Raises:
            AnalysisError: There is no such column.
            TooLittleDataError: No game has these values.
        """
        kept = self.episodes
        for name, wanted in values.items():
            self.check_column(name)
            choices = [wanted] if isinstance(wanted, str) or not isinstance(wanted, Collection) else list(wanted)
            found = kept[kept[name].isin(choices) | (kept[name].isna() & (None in choices))]
            if found.empty:
                raise TooLittleDataError(f"no game has {name} {_listed(choices)}: there are {_values(kept[name])}")
            kept = found
        return replace(self, episodes=kept.reset_index(drop=True))

    def check_column(self, name: str) -> None:
        """Checks that the table `episodes` has this column.

        Raises:
            AnalysisError: There is no such column; the error lists similar ones.
        """
        if name not in self.episodes:
            near = difflib.get_close_matches(name, self.episodes.columns, n=3) or self.episodes.columns[:10]
            raise AnalysisError(f"games have no column {name!r}: choose by {', '.join(near)}")

    def require(self, names: Collection[str], definition: Definition = "paper") -> None:
        """Checks that the games were measured.

        Raises:
            MissingColumnsError: The export has no such metric.
        """
        missing = [name for name in names if column(name, definition) not in self.episodes]
        if missing:
            raise MissingColumnsError(
                f"the table episodes of {self.source} has no metric {_listed(missing)}: it is of an earlier version or "
                f"lacks that definition; {HOW_TO_EXPORT}"
            )

    def one_setting(self, but: Collection[str] = ()) -> None:
        """Checks that the games of each task may be compared.

        Args:
            but: Columns that may differ.

        Raises:
            MixedSettingsError: Games differ in another setting.
        """
        for names, by in ((self._settings(), ["task"]), (SAMPLING, ["task", "model"])):
            for keys, games in self.episodes.groupby(by):
                for name in names:
                    if name not in but and games[name].nunique(dropna=False) > 1:
                        raise MixedSettingsError(
                            f"{', '.join(map(str, keys))}: games with {name} {_values(games[name])} are not averaged; "
                            f"choose one, as in load(…, {name}={_python(games[name].iloc[0])})"
                        )

    def _settings(self) -> tuple[str, ...]:
        return (*SETTINGS, *(name for name in LATER_SETTINGS if name in self.episodes))


def load(source: str | Path | Sequence[str | Path], *, token: str | None = None, **where: Any) -> Games:
    """Reads the games of exports, or of a server.

    Games that have not ended, voided games, and games whose seats had several holders are left out, unless `status`,
    `void_reason` or `mixed` choose them.

    Args:
        source: A folder with `episodes`, `rounds`, `acts` and perhaps `heard` and `views` (`.parquet` or `.jsonl`), the
            address of a server, or several of these.
        token: A key for that server. Default: the key of the environment.
        **where: Values of columns, as in `load("games", task="Pursuit", num_agents=12)`; a list allows several.

    Raises:
        FilesError: A file is missing or damaged.
        TooLittleDataError: There is no game.
        MixedMeasuresError: The games were measured with different embedders or revisions.
    """
    sources = [source] if isinstance(source, str | Path) else list(source)
    downloads = {name: _Download(name, token) for name in sources if _is_address(name)}
    folders = tuple(downloads[name].folder if name in downloads else Path(name) for name in sources)
    name = ", ".join(map(str, sources))
    episodes = _joined([_episodes(folder) for folder in folders]).drop_duplicates("episode", ignore_index=True)
    if episodes.empty:
        raise TooLittleDataError(f"{name} has no games: play some, for example with `swarmbench eval`, and export them")
    games = Games(name, folders, _with_sampling(episodes), (), tuple(downloads.values()))
    games = _comparable(games.where(**where), where)
    _one_measure(games.episodes)
    return games


def _is_address(source: str | Path) -> bool:
    return isinstance(source, str) and source.startswith(("http://", "https://"))


def _episodes(folder: Path) -> pd.DataFrame:
    path = _file(folder, "episodes")
    if path is None:
        found = "has no table 'episodes'" if folder.is_dir() else "is no folder"
        raise FilesError(f"{folder} {found}: {HOW_TO_EXPORT}")
    episodes = _read(path, None)
    missing = [name for name in REQUIRED if name not in episodes]
    if missing and not episodes.empty:
        raise MissingColumnsError(f"{path} has no column {_listed(missing)}: {HOW_TO_EXPORT}")
    return episodes


def _joined(parts: list[pd.DataFrame]) -> pd.DataFrame:
    filled = [part for part in parts if not part.empty]
    return pd.concat(filled or parts[:1], ignore_index=True)


def _fetch(client: Client, folder: Path) -> None:
    for table in TABLES:
        name = f"{table}.parquet"
        try:
            client.export(name, folder / name)
        except ApiError as error:
            # A server of an earlier version has fewer tables.
            if table not in OPTIONAL_TABLES or error.status not in {400, 404}:
                raise


def _file(folder: Path, table: str) -> Path | None:
    return next((path for end in ("parquet", "jsonl") if (path := folder / f"{table}.{end}").is_file()), None)


def _read(path: Path, columns: list[str] | None) -> pd.DataFrame:
    try:
        table = _parquet(path, columns) if path.suffix == ".parquet" else _lines(path, columns)
    except (pa.ArrowInvalid, OSError) as error:
        reason = str(error).splitlines()[0]
        raise FilesError(f"{path} is damaged or cut ({reason}): {HOW_TO_EXPORT}") from error
    missing = [name for name in columns or ["episode"] if name not in table.column_names]
    if missing:
        raise MissingColumnsError(f"{path} has no column {_listed(missing)}: {HOW_TO_EXPORT}")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def _parquet(path: Path, columns: list[str] | None) -> pa.Table:
    with pyarrow.parquet.ParquetFile(path) as file:
        present = file.schema_arrow.names
        return file.read(columns=None if columns is None else [name for name in columns if name in present])


def _lines(path: Path, columns: list[str] | None) -> pa.Table:
    if path.stat().st_size == 0:
        return pa.table({name: pa.array([], pa.string()) for name in columns or ["episode"]})
    # The receiver is a name in the table acts, and a number in the table heard.
    texts = [name for name in _TEXTS if (path.stem, name) != ("heard", "receiver")]
    schema = pa.schema([(name, pa.string()) for name in texts])
    table = pyarrow.json.read_json(
        path,
        read_options=pyarrow.json.ReadOptions(block_size=LINE_BYTES_MAX),
        parse_options=pyarrow.json.ParseOptions(explicit_schema=schema),
    )
    # Columns of the schema that the file lacks were added, without values.
    with path.open(encoding="utf-8") as file:
        first = json.loads(file.readline())
    return table.select([name for name in table.column_names if name in first and (columns is None or name in columns)])


def _with_sampling(episodes: pd.DataFrame) -> pd.DataFrame:
    metas = [_object(text) for text in episodes.get("agent_meta", pd.Series(index=episodes.index, dtype=object))]
    found = {name: pd.to_numeric(pd.Series([meta.get(name) for meta in metas]), errors="coerce") for name in SAMPLING}
    return episodes.reset_index(drop=True).assign(**found)


def _object(text: object) -> Mapping[str, Any]:
    try:
        value = json.loads(text) if isinstance(text, str) else {}
    except ValueError:
        value = {}
    return value if isinstance(value, dict) else {}


def _comparable(games: Games, where: Mapping[str, Any]) -> Games:
    episodes, left_out = games.episodes, []
    rules = (
        ("status", episodes["score"].isna() | episodes["reason"].isna(), "have not ended"),
        ("void_reason", _column(episodes, "void_reason").notna(), "were voided"),
        ("mixed", _column(episodes, "mixed").eq(True).fillna(False).astype(bool), "had seats of several holders"),
    )
    keep = pd.Series(True, index=episodes.index)
    for name, wrong, why in rules:
        if name not in where and wrong.any():
            left_out.append(f"{int(wrong.sum())} of {len(episodes)} games {why}, and are left out.")
            keep &= ~wrong
    if not keep.any():
        raise TooLittleDataError(f"{games.source} has no game that can be compared: {' '.join(left_out)}")
    return replace(games, episodes=episodes[keep].reset_index(drop=True), left_out=tuple(left_out))


def _column(frame: pd.DataFrame, name: str) -> "pd.Series[Any]":
    return frame[name] if name in frame else pd.Series(None, index=frame.index, dtype=object)


def _one_measure(episodes: pd.DataFrame) -> None:
    for name, what in (("metrics_revision", "revisions of the metrics"), ("embedder", "embedders")):
        values = _column(episodes, name).dropna()
        if values.nunique() > 1:
            raise MixedMeasuresError(
                f"the games were measured with two or more {what} ({_values(values)}), whose values cannot be compared"
                f": choose one, as in load(…, {name}={_python(values.iloc[0])}), or measure all again"
            )


def _values(values: "pd.Series[Any]") -> str:
    return _listed(sorted(values.unique().tolist(), key=str))


def _listed(values: Collection[object]) -> str:
    shown = [str(value) for value in list(values)[:VALUES_SHOWN_MAX]]
    return ", ".join(shown) + (" …" if len(values) > VALUES_SHOWN_MAX else "")


def _python(value: Any) -> str:
    return repr(value.item() if hasattr(value, "item") else value)
