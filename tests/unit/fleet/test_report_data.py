"""Medians, differences and intervals beside plain loops over the same numbers."""

import math
import random
import statistics as plain

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.report.data import compare, median, median_with_unfinished

DURATIONS_S = st.floats(0.5, 60.0)


def brute_force(values: list[float], statistic, resamples: int) -> tuple[float, float]:
    """The 95 % percentile interval of the bootstrap with a generator of its own."""
    generator = random.Random(7)
    told = sorted(statistic(generator.choices(values, k=len(values))) for _ in range(resamples))
    return told[round(0.025 * resamples)], told[round(0.975 * resamples)]


def series(values: dict[object, float]) -> "pd.Series[float]":
    return pd.Series(values, dtype=float)


def test_the_interval_of_a_median_agrees_with_a_bootstrap_written_as_a_loop():
    generator = random.Random(1)
    values = [generator.gauss(8.0, 1.5) for _ in range(40)]
    estimate = median(pd.Series(values))
    low, high = brute_force(values, plain.median, 4000)
    assert estimate.value == plain.median(values)
    assert estimate.low == pytest.approx(low, abs=0.1)
    assert estimate.high == pytest.approx(high, abs=0.1)


def test_two_methods_are_resampled_scenario_by_scenario():
    generator = random.Random(2)
    theirs = {str(i): generator.uniform(5.0, 15.0) for i in range(40)}
    ours = {scenario: 1.1 * value + generator.gauss(0.0, 0.1) for scenario, value in theirs.items()}
    compared = compare(series(ours), series(theirs))
    pairs = [(ours[scenario], theirs[scenario]) for scenario in theirs]

    def ratio(chosen):
        return plain.median(one for one, _ in chosen) / plain.median(other for _, other in chosen)

    low, high = brute_force(pairs, ratio, 4000)
    assert compared.ratio.value == pytest.approx(ratio(pairs))
    assert compared.ratio.low == pytest.approx(low, abs=0.005)
    assert compared.ratio.high == pytest.approx(high, abs=0.005)
    assert compared.ratio.high - compared.ratio.low < 0.1, "resampled apart, it would be over 0.5"
    low, high = brute_force(pairs, lambda chosen: plain.median(one - other for one, other in chosen), 4000)
    assert compared.difference.low == pytest.approx(low, abs=0.03)
    assert compared.difference.high == pytest.approx(high, abs=0.03)


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


@pytest.mark.parametrize("values", [[5.0, 5.0, 5.0], [5.0, 7.0]])
def test_an_interval_holds_its_value_and_lies_within_the_sample(values):
    estimate = median(pd.Series(values))
    assert min(values) <= estimate.low <= estimate.value <= estimate.high <= max(values)


def test_one_scenario_has_a_value_without_an_interval_and_none_has_nothing():
    assert median(series({"a": 7.5})) == (7.5, None, None)
    assert median(series({"a": math.nan})) is None
    assert compare(series({"a": 6.0}), series({"a": 5.0})).ratio == (1.2, None, None)


def test_the_same_numbers_give_the_same_interval_in_whatever_order_they_are_asked_for():
    values, others = pd.Series([1.0, 2.0, 4.0, 8.0]), pd.Series([3.0, 5.0])
    first, _, third = median(values), median(others), median(values)
    assert first == third


@given(st.lists(DURATIONS_S, max_size=8), st.lists(DURATIONS_S | st.none(), min_size=1, max_size=8))
def test_what_is_unfinished_counts_as_longer_than_everything(finished, unfinished):
    expected = plain.median([*finished, *[1e9] * len(unfinished)])
    values = pd.Series([*finished, *unfinished], dtype=float)
    is_unfinished = pd.Series([index >= len(finished) for index in range(len(values))])
    told = median_with_unfinished(values, is_unfinished)
    assert told == expected if expected <= 60.0 else math.isinf(told)
