"""Medians over scenarios, differences in the same scenarios, and how sure they are.

Intervals are 95 % percentile intervals of the bootstrap (Efron and Tibshirani 1993, "An Introduction to the
Bootstrap", chapter 13) over scenarios; two methods are resampled together, scenario by scenario.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

CONFIDENCE = 0.95
RESAMPLES = 9999
SEED = 0
"""Of the resampling: the same runs give the same intervals."""
BATCH = 1000
"""Resamples at a time, so that huge suites need little memory."""
EQUAL = 1e-9
"""Differences below this are rounding."""


class Estimate(NamedTuple):
    """A statistic with its confidence interval, whose ends are None for a single scenario."""

    value: float
    low: float | None
    high: float | None


class Comparison(NamedTuple):
    """A method beside another one, over the scenarios of which both have a value."""

    scenarios: int
    ratio: Estimate
    """Of the two medians."""
    difference: Estimate
    """Median of the differences in each scenario."""
    less: int
    """Scenarios in which the value is smaller than the other method's."""
    equal: int
    more: int


def median(values: Sequence[float]) -> Estimate | None:
    """The median; None of nothing."""
    if not values:
        return None
    return _estimate(np.median, np.asarray(values))


def median_with_missing(values: Sequence[float], missing: int) -> float:
    """The median if as many more values as are missing were larger than all others; infinite if it is one."""
    return float(np.median([*values, *[math.inf] * missing]))


def compare(own: Mapping[str, float], other: Mapping[str, float]) -> Comparison | None:
    """A method beside another one; None if no scenario has a value of both.

    Args:
        own: values of the method, by scenario.
        other: those of the method that it is compared with.
    """
    both = [scenario for scenario in own if scenario in other]
    if not both:
        return None
    ours = np.array([own[scenario] for scenario in both])
    theirs = np.array([other[scenario] for scenario in both])
    differences = ours - theirs
    less, more = int(np.sum(differences < -EQUAL)), int(np.sum(differences > EQUAL))
    return Comparison(
        scenarios=len(both),
        ratio=_estimate(_ratio_of_medians, ours, theirs),
        difference=_estimate(np.median, differences),
        less=less,
        equal=len(both) - less - more,
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
