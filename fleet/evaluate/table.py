"""The end of an evaluation on the terminal: a table of the methods."""

from collections.abc import Iterable, Sequence
from statistics import median

from rich.table import Table

from fleet.evaluate.row import Row
from fleet.record.tables import new_table, number


def method_table(rows: Sequence[Row]) -> Table:
    """One line a method and level of noise; medians over the runs in which all robots arrived."""
    table = new_table(
        "Medians over the runs in which all arrived",
        "Method",
        "Noise",
        "Runs",
        "All\narrived",
        "Collided",
        "Failed",
        "Duration\nin s",
        "Mean robot\nin s",
        "Decide CPU\nms, p99",
        names=2,
    )
    for method, noise in dict.fromkeys((row.method, row.noise) for row in rows):
        group = [row for row in rows if (row.method, row.noise) == (method, noise)]
        table.add_row(
            method,
            noise,
            str(len(group)),
            str(sum(row.duration_s is not None for row in group)),
            str(sum(bool(row.collisions) for row in group)),
            str(sum(row.failed for row in group)),
            number(_median(row.duration_s for row in group)),
            number(_median(row.robot_duration_mean_s for row in group)),
            number(max(_known(row.decide_cpu_p99_ms for row in group), default=None)),
        )
    return table


def _median(values: Iterable[float | None]) -> float | None:
    known = _known(values)
    return median(known) if known else None


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
