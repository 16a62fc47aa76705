"""Medians, differences and intervals beside plain loops over the same numbers."""

import math
import random
import statistics as plain

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.report.data import compare, median, median_with_unfinished

DURATIONS_S = st.floats(0.5, 60.0)


def brute_force(values: list, statistic) -> tuple[float, float]:
    """The 95 % percentile interval of the bootstrap with a generator of its own."""
    generator = random.Random(7)
    told = sorted(statistic(generator.choices(values, k=len(values))) for _ in range(2000))
    return told[50], told[1950]


def series(values: dict[object, float]) -> "pd.Series[float]":
    return pd.Series(values, dtype=float)


def test_intervals_agree_with_a_bootstrap_written_as_a_loop_that_resamples_two_methods_together():
    generator = random.Random(2)
    theirs = {str(i): generator.uniform(5.0, 15.0) for i in range(40)}
    ours = {scenario: 1.1 * value + generator.gauss(0.0, 0.1) for scenario, value in theirs.items()}
    pairs = [(ours[scenario], theirs[scenario]) for scenario in theirs]

    def ratio(chosen):
        return plain.median(one for one, _ in chosen) / plain.median(other for _, other in chosen)

    def difference(chosen):
        return plain.median(one - other for one, other in chosen)

    compared = compare(series(ours), series(theirs))
    for estimate, sample, statistic, tolerance in (
        (median(series(ours)), list(ours.values()), plain.median, 0.2),
        (compared.ratio, pairs, ratio, 0.005),
        (compared.difference, pairs, difference, 0.03),
    ):
        assert estimate.value == pytest.approx(statistic(sample))
        assert estimate[1:] == pytest.approx(brute_force(sample, statistic), abs=tolerance)
    assert compared.ratio.high - compared.ratio.low < 0.1, "resampled apart, it would be over 0.5"
    assert median(series(ours)) == median(series(ours)), "the same numbers give the same interval"


@settings(max_examples=20)
@given(
    st.dictionaries(st.integers(0, 9), DURATIONS_S, max_size=6),
    st.dictionaries(st.integers(0, 9), DURATIONS_S, max_size=6),
)
def test_only_scenarios_with_both_values_are_compared(ours, theirs):
    both = ours.keys() & theirs.keys()
    compared = compare(series(ours), series(theirs))
    if not both:
        assert compared is None
        return
    differences = [ours[each] - theirs[each] for each in both]
    assert len(both) == compared.less + compared.equal + compared.more
    assert compared.difference.value == pytest.approx(plain.median(differences))
    assert compared.less == sum(each < -1e-9 for each in differences)
    assert compared.more == sum(each > 1e-9 for each in differences)


def test_one_scenario_has_a_value_without_an_interval_and_none_has_nothing():
    assert median(series({"a": 7.5})) == (7.5, None, None)
    assert median(series({"a": math.nan})) is None
    assert compare(series({"a": 6.0}), series({"a": 5.0})).ratio == (1.2, None, None)


@settings(max_examples=30)
@given(st.lists(DURATIONS_S, max_size=8), st.lists(DURATIONS_S | st.none(), min_size=1, max_size=8))
def test_what_is_unfinished_counts_as_longer_than_everything(finished, unfinished):
    expected = plain.median([*finished, *[1e9] * len(unfinished)])
    values = pd.Series([*finished, *unfinished], dtype=float)
    is_unfinished = pd.Series([index >= len(finished) for index in range(len(values))])
    told = median_with_unfinished(values, is_unfinished)
    assert told == expected if expected <= 60.0 else math.isinf(told)
