"""What box plots show, read from their axes."""

import statistics
from pathlib import Path

import numpy as np
import pytest
from evaluation_helpers import SHORT, evaluation_of, write_suite
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from reporting_helpers import row

from fleet.report.data import Data, publication
from fleet.report.figures import BEYOND, COLLISION, DOT, PUBLISHED, Chart, charts, collision_distance_m
from protocol.scenario import Scenario

DURATIONS_S = {"exchanged": [6.0, 7.0, 6.5, 9.0, 20.0], "joint-fit": [7.0, 7.5, 8.0, 8.5, 10.0]}
DISTANCES_M = [1.39, 1.4, 0.9, 1.45, 5.0]
PAIR = Scenario(name="pair", **SHORT)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Chart]:
    suite: Path = write_suite(tmp_path_factory.mktemp("drawn") / "suite", *"01234")
    evaluation = evaluation_of(suite, goals=tuple(DURATIONS_S))
    rows = []
    for run in evaluation.runs():
        distance_m = DISTANCES_M[int(run.key.scenario)]
        duration_s = DURATIONS_S[run.key.method][int(run.key.scenario)]
        figures = {"duration_s": duration_s, "robot_duration_mean_s": duration_s - 1.0}
        hit = int(distance_m < 0.99)
        rows.append(row(run, **figures, minimum_distance_m=distance_m, collisions=hit))
    (level,) = Data(evaluation, rows, "exchanged").levels
    return charts(level, [PAIR])


def axes_of(chart: Chart) -> Axes:
    (axes,) = chart.figure().axes
    return axes


def marked(axes: Axes, style: dict[str, object]) -> list[float]:
    marker = style["marker"]
    return sorted(float(x) for line in axes.lines if line.get_marker() == marker for x in line.get_xdata())


def boxes(axes: Axes) -> list[tuple[float, float]]:
    """The ends of all boxes, from top to bottom."""
    patches = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    ends = [patch.get_path().vertices for patch in patches]
    return [(x.min(), x.max()) for x, y in sorted((each.T for each in ends), key=lambda each: each[1].min())]


def test_boxes_are_the_quartiles_of_each_method_from_top_to_bottom(drawn: dict[str, Chart]):
    expected = []
    for durations_s in DURATIONS_S.values():
        low, _, high = statistics.quantiles(durations_s, n=4, method="inclusive")
        expected += [(low, high), (low - 1.0, high - 1.0)]
    assert np.array(boxes(axes_of(drawn["duration"]))) == pytest.approx(np.array(expected))


def test_every_scenario_is_a_dot_and_those_with_a_collision_are_crosses(drawn: dict[str, Chart]):
    assert [marked(axes, DOT) for axes in drawn["driven"].figure().axes] == [[16.0] * 8, [8.0] * 8]
    axes = axes_of(drawn["duration"])
    hit = [each[2] for each in DURATIONS_S.values()]
    assert marked(axes, COLLISION) == sorted(hit + [each - 1.0 for each in hit])
    others = [each for durations_s in DURATIONS_S.values() for i, each in enumerate(durations_s) if i != 2]
    assert marked(axes, DOT) == sorted(others + [each - 1.0 for each in others])


def test_published_medians_are_marked_for_the_published_methods_only(drawn: dict[str, Chart]):
    forty = publication()["forty_scenarios"]
    medians_s = [forty[key]["median"][0] for key in ("duration_per_robot_s", "duration_all_robots_s")]
    assert marked(axes_of(drawn["duration"]), PUBLISHED) == sorted(medians_s)
    assert marked(axes_of(drawn["distance"]), PUBLISHED) == forty["minimum_distance_m"]["smallest"][:1]
    times_ms = [
        1000.0 * forty[f"solve_time_{phase}_s"]["median"][0]
        for phase in ("planning", "prediction")
        if forty[f"solve_time_{phase}_s"]["median"][0] is not None
    ]
    assert marked(axes_of(drawn["times"]), PUBLISHED) == pytest.approx(sorted(times_ms))


def test_distances_have_the_line_of_collisions_and_end_where_nobody_meets(drawn: dict[str, Chart]):
    axes = axes_of(drawn["distance"])
    (line,) = [line for line in axes.lines if set(line.get_xdata()) == {0.99}]
    assert line.get_marker() == "None"
    assert marked(axes, BEYOND) == [pytest.approx(1.5 * 1.39)] * 2
    assert axes.get_xlim()[1] < 2.2


def test_bodies_of_different_sizes_have_no_common_line():
    large = PAIR.model_copy(
        update={"robots": [PAIR.robots[0].model_copy(update={"radius_m": 0.6}), PAIR.robots[1]]}
    )
    assert collision_distance_m([PAIR]) == 0.99
    assert collision_distance_m([PAIR, large]) is None
