"""The publication's own figures: those of ``publication.json``, which ``publication.md`` explains."""

import json
from functools import cache
from importlib.resources import files
from typing import Any

from fleet.report.measures import DRIVEN, DURATION, ROBOT_DRIVEN, ROBOT_DURATION

SOURCE = "Majer et al. (2026)"
_METHODS = {
    "exchanged": "exchanged",
    "ioc": "ioc",
    "constant-acceleration": "constant_acceleration",
}
"""What the publication has of ours, and its name in the file."""
_KEYS = {
    DURATION.column: "duration_all_robots_s",
    ROBOT_DURATION.column: "duration_per_robot_s",
    DRIVEN.column: "driven_distance_all_m",
    ROBOT_DRIVEN.column: "driven_distance_per_robot_m",
}
_SOLVE_TIMES = {"plan": "solve_time_planning_s", "predict": "solve_time_prediction_s"}


@cache
def publication() -> dict[str, Any]:
    """The whole file."""
    text = files("fleet.report").joinpath("publication.json").read_text(encoding="utf-8")
    content: dict[str, Any] = json.loads(text)
    return content


def median_of(method: str, column: str) -> float | None:
    """The published median over its forty scenarios of a column of a run's row; None if there is none."""
    if column not in _KEYS:
        return None
    return _of(method, _forty()[_KEYS[column]]["median"])


def solve_time_ms(method: str, phase: str) -> float | None:
    """The published median over scenarios of their mean solve time of a phase; None if there is none.

    It is wall-clock time on the authors' computer.
    """
    if phase not in _SOLVE_TIMES:
        return None
    time_s = _of(method, _forty()[_SOLVE_TIMES[phase]]["median"])
    return None if time_s is None else 1000.0 * time_s


def smallest_distance_m(method: str) -> float | None:
    """The smallest distance in all of the published scenarios."""
    return _of(method, _forty()["minimum_distance_m"]["smallest"])


def collided(method: str) -> int | None:
    """In how many of the published scenarios robots collided."""
    count = _of(method, _forty()["minimum_distance_m"]["scenarios_below_collision"])
    return None if count is None else int(count)


def solver_failures(method: str) -> int | None:
    """How often the published solver found no solution."""
    count = _of(method, _forty()["solver_failures"])
    return None if count is None else int(count)


def duration_of_8a_s(method: str) -> float | None:
    """The published duration of scenario 8a."""
    durations_s: dict[str, float] = publication()["scenario_8a"]["reported_duration_s"]
    return durations_s.get(_METHODS.get(method, ""))


def _forty() -> dict[str, Any]:
    forty: dict[str, Any] = publication()["forty_scenarios"]
    return forty


def _of(method: str, values: list[float | None]) -> float | None:
    if method not in _METHODS:
        return None
    methods: list[str] = _forty()["methods"]
    return values[methods.index(_METHODS[method])]
