"""Medians, differences and intervals beside plain loops, and the box plots that show the numbers."""

import math
import random
import statistics as plain
from pathlib import Path

import pandas as pd
import pytest
from evaluation_helpers import SHORT, evaluation_of, write_suite
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from reporting_helpers import row

from fleet.report.data import Data, compare, median, median_with_unfinished, publication
from fleet.report.figures import COLLISION, DOT, PUBLISHED, charts
from protocol.scenario import Scenario

SECONDS = st.floats(0.5, 60.0)


def brute_force(values: list, statistic) -> tuple[float, float]:
    """The 95 % percentile interval of the bootstrap with a generator of its own."""
    generator = random.Random(7)
    told = sorted(statistic(generator.choices(values, k=len(values))) for _ in range(1000))
    return told[25], told[975]


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


@settings(max_examples=8)
@given(
    st.dictionaries(st.integers(0, 9), SECONDS, max_size=6),
    st.dictionaries(st.integers(0, 9), SECONDS, max_size=6),
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


@settings(max_examples=15)
@given(st.lists(SECONDS, max_size=8), st.lists(SECONDS | st.none(), min_size=1, max_size=8))
def test_what_is_unfinished_counts_as_longer_than_everything(finished, unfinished):
    expected = plain.median([*finished, *[1e9] * len(unfinished)])
    values = pd.Series([*finished, *unfinished], dtype=float)
    is_unfinished = pd.Series([index >= len(finished) for index in range(len(values))])
    told = median_with_unfinished(values, is_unfinished)
    assert told == expected if expected <= 60.0 else math.isinf(told)


def marked(axes: Axes, style: dict[str, object]) -> list[float]:
    marker = style["marker"]
    return sorted(float(x) for line in axes.lines if line.get_marker() == marker for x in line.get_xdata())


def test_every_scenario_is_a_dot_those_with_a_collision_are_crosses_and_published_medians_are_marked(
    tmp_path: Path,
):
    durations_s = {"exchanged": [6.0, 7.0, 9.0], "joint-fit": [7.0, 7.5, 10.0]}
    evaluation = evaluation_of(write_suite(tmp_path / "suite", *"012"), goals=tuple(durations_s))
    rows = []
    for run in evaluation.runs():
        duration_s, hit = durations_s[run.key.method][int(run.key.scenario)], run.key.scenario == "1"
        figures = {"duration_s": duration_s, "robot_duration_mean_s": duration_s - 1.0}
        rows.append(row(run, **figures, collisions=int(hit)))
    (level,) = Data(evaluation, rows, "exchanged").levels
    (axes,) = charts(level, [Scenario(name="pair", **SHORT)])["duration"].figure().axes
    assert marked(axes, DOT) == [5.0, 6.0, 6.0, 7.0, 8.0, 9.0, 9.0, 10.0]
    assert marked(axes, COLLISION) == [6.0, 6.5, 7.0, 7.5]
    forty = publication()["forty_scenarios"]
    medians_s = [forty[key]["median"][0] for key in ("duration_per_robot_s", "duration_all_robots_s")]
    assert marked(axes, PUBLISHED) == sorted(medians_s), "for the published method only"
