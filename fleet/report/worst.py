"""The worst runs: which they are, and what made them so."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from fleet.evaluate.results import Row
from fleet.report.measures import all_arrived


class Worst(NamedTuple):
    """One of the worst runs, and why it is."""

    row: Row
    why: str


def worst_runs(rows: Sequence[Row], against: str, count: int) -> list[Worst]:
    """The worst runs first: failed ones, then with collisions, then without arrival, then the slowest.

    Slow is what takes long beside the same scenario, noise and seed with the reference method.

    Args:
        rows: all runs.
        against: the reference method.
        count: most that are wanted.
    """
    base_s = _durations_s(row for row in rows if row.method == against)
    ranked = sorted(rows, key=lambda row: _rank(row, _ratio(row, base_s)))
    return [Worst(row, _why(row, against, _ratio(row, base_s))) for row in ranked[:count]]


def _durations_s(rows: Iterable[Row]) -> dict[tuple[str, str, int], float]:
    return {(row.scenario, row.noise, row.seed): row.duration_s for row in rows if row.duration_s is not None}


def _ratio(row: Row, base_s: dict[tuple[str, str, int], float]) -> float | None:
    base = base_s.get((row.scenario, row.noise, row.seed))
    # Whoever starts at its goal arrives after 0 s.
    return row.duration_s / base if row.duration_s is not None and base else None


def _rank(row: Row, ratio: float | None) -> tuple[float, ...]:
    """The smaller, the worse; sorting is stable, so of equals the earlier one comes first."""
    if row.failed:
        return (0.0,)
    nearest_m = math.inf if row.minimum_distance_m is None else row.minimum_distance_m
    if row.collisions:
        return 1.0, -float(row.collisions), nearest_m
    if not all_arrived(row):
        return 2.0, (row.arrived or 0) / row.robots, nearest_m
    return 3.0, -(ratio or 0.0), -(row.duration_s or 0.0)


def _why(row: Row, against: str, ratio: float | None) -> str:
    if row.failed:
        return f"failed: {row.reason}"
    if row.collisions:
        pairs = "1 pair of robots" if row.collisions == 1 else f"{row.collisions} pairs of robots"
        return f"collision of {pairs}"
    if not all_arrived(row):
        return f"{row.verdict}: {row.arrived} of {row.robots} robots arrived"
    if ratio is None or row.method == against:
        return f"took {row.duration_s:.1f} s"
    return f"took {row.duration_s:.1f} s, {ratio:.2f} times as long as with {against}"
