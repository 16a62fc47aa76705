"""What box plots show, read from their axes."""

import statistics

import numpy as np
import pytest
from evaluation_helpers import SHORT
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from fleet.evaluate.results import Row
from fleet.report import published
from fleet.report.boxes import BEYOND, COLLISION, DOT, PUBLISHED, Chart
from fleet.report.charts import charts, collision_distance_m
from fleet.report.measures import Group
from protocol.scenario import Scenario

DURATIONS_S = {"exchanged": [6.0, 7.0, 6.5, 9.0, 20.0], "joint-fit": [7.0, 7.5, 8.0, 8.5, 10.0]}
DISTANCES_M = [1.39, 1.4, 0.9, 1.45, 5.0]
PAIR = Scenario(name="pair", **SHORT)


def group(method: str) -> Group:
    rows = [
        Row(
            scenario=str(index),
            robots=2,
            method=method,
            solver="realtime",
            noise="none",
            seed=0,
            verdict="collision" if distance_m < 0.99 else "arrived",
            duration_s=duration_s,
            robot_duration_mean_s=duration_s - 1.0,
            minimum_distance_m=distance_m,
            collisions=int(distance_m < 0.99),
        )
        for index, (duration_s, distance_m) in enumerate(zip(DURATIONS_S[method], DISTANCES_M, strict=True))
    ]
    return Group(method, "none", rows)


@pytest.fixture(scope="module")
def drawn() -> dict[str, Chart]:
    return charts([group(method) for method in DURATIONS_S], [PAIR])


def axes_of(chart: Chart) -> Axes:
    figure = Figure()
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    chart.draw(axes)
    return axes


def marked(axes: Axes, marker: str) -> list[float]:
    return sorted(float(x) for line in axes.lines if line.get_marker() == marker for x in line.get_xdata())


def boxes(axes: Axes) -> list[tuple[float, float]]:
    """The ends of all boxes, from top to bottom."""
    patches = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    ends = [patch.get_path().vertices for patch in patches]
    return [(x.min(), x.max()) for x, y in sorted((each.T for each in ends), key=lambda each: each[1].min())]


def test_boxes_are_the_quartiles_of_each_method_from_top_to_bottom(drawn: dict[str, Chart]):
    told = boxes(axes_of(drawn["duration"]))
    expected = []
    for durations_s in DURATIONS_S.values():
        low, _, high = statistics.quantiles(durations_s, n=4, method="inclusive")
        expected += [(low, high), (low - 1.0, high - 1.0)]
    assert np.array(told) == pytest.approx(np.array(expected))


def test_every_scenario_is_a_dot_and_those_with_a_collision_are_crosses(drawn: dict[str, Chart]):
    axes = axes_of(drawn["duration"])
    hit = [each[2] for each in DURATIONS_S.values()]
    assert marked(axes, COLLISION) == sorted(hit + [each - 1.0 for each in hit])
    others = [each for durations_s in DURATIONS_S.values() for i, each in enumerate(durations_s) if i != 2]
    assert marked(axes, DOT) == sorted(others + [each - 1.0 for each in others])


def test_published_medians_are_marked_for_the_published_methods_only(drawn: dict[str, Chart]):
    forty = published.publication()["forty_scenarios"]
    medians_s = [forty[key]["median"][0] for key in ("duration_per_robot_s", "duration_all_robots_s")]
    assert marked(axes_of(drawn["duration"]), PUBLISHED) == sorted(medians_s)
    assert marked(axes_of(drawn["distance"]), PUBLISHED) == forty["minimum_distance_m"]["smallest"][:1]
    times_ms = [1000.0 * forty["solve_time_planning_s"]["median"][0]]
    assert marked(axes_of(drawn["times"]), PUBLISHED) == pytest.approx(times_ms)


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
