"""How the tables of a report look."""

from rich import box
from rich.table import Table


def new_table(title: str, *headers: str, names: int = 1) -> Table:
    """An empty table: columns of names first, then columns of numbers; a row is never broken."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for index, header in enumerate(headers):
        table.add_column(header, justify="left" if index < names else "right", no_wrap=True)
    return table


def number(value: float | None) -> str:
    """A number with what digits matter; a dash for none."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) < 0.01:
        return f"{value:.0e}"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
