"""Tables as Markdown, LaTeX and HTML. Everything that comes from players is escaped."""

import html
import math
from typing import Any

import pandas as pd

DIGITS = 4
"""The significant digits of numbers; CSV files have all digits."""

_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
        "–": "--",
        **{character: f"\\{character}" for character in "{}$&#_%"},
    }
)

_MARKDOWN = str.maketrans({**{character: f"\\{character}" for character in "\\`*_{}[]<>|#~$"}, "\n": " "})


def cell(value: Any) -> str:
    """A value as text, empty if the value is missing."""
    if value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


def latex_text(text: str) -> str:
    """Text that LaTeX shows as it is."""
    return text.translate(_LATEX)


def markdown_text(text: str) -> str:
    """Text that Markdown shows as it is."""
    return text.translate(_MARKDOWN)


def markdown_table(table: pd.DataFrame) -> str:
    """A Markdown table."""
    rows = [list(map(str, table.columns)), *_cells(table)]
    lines = ["| " + " | ".join(map(markdown_text, row)) + " |" for row in rows]
    lines.insert(1, "|" + " --- |" * len(table.columns))
    return "\n".join(lines) + "\n"


def latex_table(table: pd.DataFrame, caption: str) -> str:
    """A table for the LaTeX package booktabs."""
    rows = [" & ".join(map(latex_text, row)) + r" \\" for row in _cells(table)]
    columns = "".join("r" if pd.api.types.is_numeric_dtype(kind) else "l" for kind in table.dtypes)
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{latex_text(caption)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            " & ".join(latex_text(str(name)) for name in table.columns) + r" \\",
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def html_table(table: pd.DataFrame) -> str:
    """A table of HTML."""
    head = "".join(f"<th>{html.escape(str(name))}</th>" for name in table.columns)
    rows = ["<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in row) + "</tr>" for row in _cells(table)]
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n" + "\n".join(rows) + "\n</tbody></table>"


def _cells(table: pd.DataFrame) -> list[list[str]]:
    return [[cell(value) for value in row] for row in table.itertuples(index=False, name=None)]
