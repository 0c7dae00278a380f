"""Output for people at a terminal: tables and paragraphs on stdout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from gppcs.app.tables import UNITS, columns_of, shown

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry


def print_comparison(entries: Sequence[Entry]) -> None:
    """Print a table with a row for each method. The best value of each column is bold.

    Parameters
    ----------
    entries : sequence of Entry
        At least one.
    """
    columns = columns_of(entries)
    names = [entry.result.method.label for entry in entries]
    widths = [max(map(len, [*column.title.split(), *map(shown, column.values)])) for column in columns]
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("method", width=(longest := max(map(len, [*names, "method"]))))
    for column, width in zip(columns, widths, strict=True):
        table.add_column(column.title, justify="right", width=width)
    for row, name in enumerate(names):
        cells = (Text(shown(column.values[row]), style="bold" if column.is_best(row) else "") for column in columns)
        table.add_row(Text(name), *cells)
    needed = longest + sum(widths) + 2 * len(columns)
    console = Console(width=max(Console().width, needed), highlight=False)  # wider than the terminal rather than cut
    console.print(table)
    console.print(UNITS, style="dim")


def print_paragraphs(paragraphs: Sequence[tuple[str, str]]) -> None:
    """Print texts, each indented below its title.

    Parameters
    ----------
    paragraphs : sequence of (title, text)
        Empty lines separate the paragraphs of a text.
    """
    console = Console(markup=False, emoji=False, highlight=False)
    for title, text in paragraphs:
        console.print(title, style="bold")
        for part in text.strip().split("\n\n"):
            console.print(Padding(" ".join(part.split()), (0, 0, 0, 4)))


def print_table(title: str, rows: Mapping[str, str]) -> None:
    """Print names and values below a title.

    Parameters
    ----------
    title : str
        The first line.
    rows : mapping of str to str
        Values by name.
    """
    console = Console(markup=False, emoji=False, highlight=False, soft_wrap=True)
    console.print(title, style="bold")
    width = max(map(len, rows))
    for name, value in rows.items():
        console.print(f"{name:<{width}}  {value}".rstrip())
