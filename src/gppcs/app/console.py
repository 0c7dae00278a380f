"""Output for people at a terminal: tables and paragraphs on stdout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from gppcs.app.printing import visible
from gppcs.app.tables import Row, as_text, columns_of, units_of


def print_comparison(rows: Sequence[Row]) -> None:
    """Print a table of a comparison. The best value of each column is bold."""
    columns = columns_of(rows)
    widths = [max(map(len, [*column.title.split(), *map(as_text, column.values)])) for column in columns]
    labels = [visible(row.label) for row in rows]
    longest = max(map(len, [*labels, rows[0].kind]))
    table = _table()
    table.add_column(rows[0].kind, width=longest)
    for column, width in zip(columns, widths, strict=True):
        table.add_column(column.title, justify="right", width=width)
    for number, label in enumerate(labels):
        cells = (
            Text(as_text(column.values[number]), style="bold" if column.is_best(number) else "") for column in columns
        )
        table.add_row(Text(label), *cells)
    _print_wide(table, longest + sum(widths) + 2 * len(columns), units_of(rows))


def print_paragraphs(paragraphs: Sequence[tuple[str, str]]) -> None:
    """Print texts, each indented below its title."""
    console = Console(markup=False, emoji=False, highlight=False)
    for title, text in paragraphs:
        console.print(visible(title), style="bold")
        for part in visible(text).strip().split("\n\n"):
            console.print(Padding(" ".join(part.split()), (0, 0, 0, 4)))


def print_table(title: str, rows: Mapping[str, str]) -> None:
    """Print names and values below a title."""
    console = Console(markup=False, emoji=False, highlight=False, soft_wrap=True)
    console.print(visible(title), style="bold")
    width = max(len(visible(name)) for name in rows)
    for name, value in rows.items():
        console.print(f"{visible(name):<{width}}  {visible(value)}".rstrip())


def _table() -> Table:
    return Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))


def _print_wide(table: Table, needed: int, units: str) -> None:
    """Print a table, wider than the terminal rather than cut, and the units of its figures."""
    console = Console(width=max(Console().width, needed), highlight=False)
    console.print(table)
    console.print(units, style="dim")
