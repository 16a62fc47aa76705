"""The data of a report: runs in a frame, a value per scenario, medians and differences with their intervals.

The unit of all statistics is the scenario: seeds of one scenario are no independent samples, so they count as
one value. Intervals are 95 % percentile intervals of the bootstrap (Efron and Tibshirani 1993, "An
Introduction to the Bootstrap", chapter 13) over scenarios; two methods are resampled together.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import bootstrap

from fleet.evaluate.evaluation import Evaluation, Run, RunKey
from fleet.evaluate.results import COLUMNS, FAILED, Row

CONFIDENCE = 0.95
RESAMPLES = 9999
SEED = 0
"""Of the resampling: the same runs give the same intervals."""
BATCH = 1000
"""Resamples at a time, so that huge suites need little memory."""
EQUAL = 1e-9
"""Differences below this are rounding."""
SOURCE = "Majer et al. (2026)"
"""The publication whose figures stand in ``publication.json``; ``publication.md`` explains them."""


class Measure(NamedTuple):
    """One figure of a run."""

    column: str
    """Of ``runs.csv``."""
    name: str
    unit: str
    of_seeds: Literal["mean", "min"] = "mean"
    """Makes one value of those of a scenario's seeds."""
    unfinished: bool = False
    """Whether runs in which not all robots arrived have it too."""


DURATION = Measure("duration_s", "duration", "s")
ROBOT_DURATION = Measure("robot_duration_mean_s", "mean duration per robot", "s")
DRIVEN = Measure("driven_m", "driven by all", "m")
ROBOT_DRIVEN = Measure("robot_driven_mean_m", "driven per robot", "m")
SMALLEST_DISTANCE = Measure("minimum_distance_m", "smallest distance", "m", "min", unfinished=True)
MEASURES = (DURATION, ROBOT_DURATION, DRIVEN, ROBOT_DRIVEN, SMALLEST_DISTANCE)
PHASES = ("estimate", "predict", "plan", "decide")


def cpu_time(phase: str, statistic: str) -> Measure:
    """The CPU time of one phase of a decision, such as the ``p99`` of ``plan``."""
    return Measure(f"{phase}_cpu_{statistic}_ms", f"{phase}, {statistic}", "ms", unfinished=True)


@dataclass(frozen=True)
class Level:
    """All runs at one level of noise."""

    noise: str
    methods: Sequence[str]
    """Those with a run, in the order of the evaluation."""
    runs: pd.DataFrame
    """One line each: the columns of ``runs.csv``, ``all_arrived``, ``unfinished``, ``collided``, verdicts."""

    def values(self, measure: Measure) -> pd.DataFrame:
        """One value for each scenario (rows) and method (columns); NaN where there is none."""
        known = self.runs if measure.unfinished else self.runs[self.runs["all_arrived"]]
        return self._by_scenario(known, measure.column, measure.of_seeds).astype(float)

    def any(self, column: Literal["unfinished", "collided"]) -> pd.DataFrame:
        """For each scenario (rows) and method (columns): whether that is so of one of its runs."""
        return self._by_scenario(self.runs, column, "max") == 1

    def _by_scenario(self, runs: pd.DataFrame, column: str, of_seeds: str) -> pd.DataFrame:
        grouped = runs.groupby(["scenario", "method"])[column].agg(of_seeds)
        return grouped.unstack().reindex(index=self.runs["scenario"].unique(), columns=list(self.methods))


@dataclass(frozen=True)
class Data:
    """An evaluation and the runs of it that are finished, in its order."""

    evaluation: Evaluation
    rows: Sequence[Row]
    against: str
    """The method with which the others are compared."""

    @cached_property
    def runs(self) -> dict[RunKey, Run]:
        """All runs of the evaluation, made or missing."""
        return {run.key: run for run in self.evaluation.runs()}

    @cached_property
    def levels(self) -> list[Level]:
        """The levels of noise that have runs."""
        frame = pd.DataFrame([dict(row) for row in self.rows], columns=list(COLUMNS))
        numbers = COLUMNS[COLUMNS.index("duration_s") :]
        frame = frame.astype(dict.fromkeys(numbers, float))
        frame["unfinished"] = frame["duration_s"].isna()
        frame["all_arrived"] = ~frame["unfinished"]
        frame["collided"] = frame["collisions"] > 0
        for verdict in ("deadlock", "timeout", FAILED):
            frame[verdict] = frame["verdict"] == verdict
        by_noise = {str(noise): runs for noise, runs in frame.groupby("noise")}
        return [
            Level(noise, [m for m in self.evaluation.goals if m in set(runs["method"])], runs)
            for noise in self.evaluation.noise
            if (runs := by_noise.get(noise)) is not None
        ]

    def title_of(self, row: Row) -> str:
        """A run in words: scenario and method, and noise and seed where they matter."""
        noise = "" if row.noise == "none" else f", noise {row.noise}"
        seeds = sum(key[:-1] == row.key[:-1] for key in self.runs)
        return f"{row.scenario}, {row.method}{noise}" + (f", seed {row.seed}" if seeds > 1 else "")


class Estimate(NamedTuple):
    """A statistic with its confidence interval, whose ends are None for a single scenario."""

    value: float
    low: float | None
    high: float | None


class Comparison(NamedTuple):
    """A method beside another one, over the scenarios of which both have a value."""

    ratio: Estimate
    """Of the two medians."""
    difference: Estimate
    """Median of the differences in each scenario."""
    less: int
    """Scenarios in which the value is smaller than the other method's."""
    equal: int
    more: int


def median(values: "pd.Series[float]") -> Estimate | None:
    """The median over those scenarios that have a value; None if none has."""
    known = np.asarray(values.dropna(), dtype=np.float64)
    return _estimate(np.median, known) if len(known) else None


def compare(own: "pd.Series[float]", other: "pd.Series[float]") -> Comparison | None:
    """A method beside another one, by scenario; None if no scenario has a value of both."""
    ours, theirs = pd.concat([own, other], axis=1).dropna().to_numpy(dtype=float).T
    if not len(ours):
        return None
    differences = ours - theirs
    less, more = int(np.sum(differences < -EQUAL)), int(np.sum(differences > EQUAL))
    return Comparison(
        ratio=_estimate(_ratio_of_medians, ours, theirs),
        difference=_estimate(np.median, differences),
        less=less,
        equal=len(ours) - less - more,
        more=more,
    )


def _ratio_of_medians(
    ours: NDArray[np.float64], theirs: NDArray[np.float64], axis: int = -1
) -> NDArray[np.float64]:
    return np.asarray(np.median(ours, axis=axis) / np.median(theirs, axis=axis))


def _estimate(statistic: Callable[..., object], *samples: NDArray[np.float64]) -> Estimate:
    value = float(statistic(*samples))  # type: ignore[arg-type]  # of one-dimensional samples it is a number
    if len(samples[0]) < 2:
        return Estimate(value, None, None)
    interval = bootstrap(
        samples,
        statistic,
        paired=len(samples) > 1,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=BATCH,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Estimate(value, float(interval.low), float(interval.high))


def median_with_unfinished(values: "pd.Series[float]", unfinished: "pd.Series[bool]") -> float:
    """The median if each unfinished scenario had taken longer than all others; infinite if it is one."""
    return float(values.mask(unfinished, math.inf).median())


@cache
def publication() -> dict[str, Any]:
    """The whole of ``publication.json``."""
    text = files("fleet.report").joinpath("publication.json").read_text(encoding="utf-8")
    content: dict[str, Any] = json.loads(text)
    return content


_PUBLISHED: dict[str, tuple[str, str, float]] = {
    DURATION.column: ("duration_all_robots_s", "median", 1.0),
    ROBOT_DURATION.column: ("duration_per_robot_s", "median", 1.0),
    DRIVEN.column: ("driven_distance_all_m", "median", 1.0),
    ROBOT_DRIVEN.column: ("driven_distance_per_robot_m", "median", 1.0),
    SMALLEST_DISTANCE.column: ("minimum_distance_m", "smallest", 1.0),
    "collided": ("minimum_distance_m", "scenarios_below_collision", 1.0),
    "solver_failures": ("solver_failures", "", 1.0),
    "plan_cpu_p50_ms": ("solve_time_planning_s", "median", 1000.0),
    "predict_cpu_p50_ms": ("solve_time_prediction_s", "median", 1000.0),
}
"""By column of the runs: where it stands in ``publication.json``, which statistic of it, and a factor."""


def published(method: str, column: str) -> float | None:
    """The publication's figure for a column, over its forty scenarios; None if it has none.

    The smallest of smallest distances, the number of scenarios with a collision, the number of problems
    without solution, and medians of all else. Times are wall-clock times on the authors' computer.
    """
    forty = publication()["forty_scenarios"]
    if column not in _PUBLISHED or method.replace("-", "_") not in forty["methods"]:
        return None
    key, statistic, factor = _PUBLISHED[column]
    values = forty[key][statistic] if statistic else forty[key]
    value = values[forty["methods"].index(method.replace("-", "_"))]
    return None if value is None else factor * float(value)
