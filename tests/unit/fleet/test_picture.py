"""The picture of a run: the right things at the right places, in a readable file."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from run_helpers import FACTS, mind, ring, straight_run, truth

from fleet.record.picture import (
    COLOURS,
    ESTIMATE,
    GOAL,
    LATE_STEPS,
    Course,
    Panel,
    View,
    draw_paths,
    shown_times_s,
)
from fleet.record.summary import Tally
from protocol.messages import Message
from protocol.scenario import Scenario

TWO = ring(2)
"""They change places between (4, 0) and (−4, 0)."""


def gather(messages: Iterable[Message]) -> Course:
    course = Course(TWO.step_s)
    for message in messages:
        course.add(message)
    return course


def draw(scenario: Scenario, messages: list[Message], path: Path) -> np.ndarray:
    tally = Tally()
    for message in messages:
        tally.add(message)
    draw_paths(scenario, gather(messages), tally.summary(FACTS), path)
    return imread(path)


def test_every_robot_leaves_its_colour_in_the_picture(tmp_path: Path) -> None:
    robots = 3
    scenario = ring(robots)
    pixels = draw(scenario, list(straight_run(scenario, 5.0)), tmp_path / "paths.png")
    assert pixels.shape[1] > 1500
    colours = (np.round(pixels[..., :3] * 255).astype(int) @ (65536, 256, 1)).ravel()
    for colour in COLOURS[:robots]:
        # Three discs at least: far more pixels than a line of text.
        assert np.count_nonzero(colours == int(colour[1:], 16)) > 2000
    assert not np.isin(colours, [int(colour[1:], 16) for colour in COLOURS[robots:]]).any()


@pytest.mark.parametrize("messages", [[], list(straight_run(TWO, 0.1))])
def test_a_run_that_broke_off_early_or_before_its_start_is_drawn_too(
    tmp_path: Path, messages: list[Message]
) -> None:
    assert draw(TWO, messages, tmp_path / "paths.png").size


def test_a_run_is_shown_at_the_published_times_or_at_its_thirds() -> None:
    assert shown_times_s(12.2) == (1.6, 3.0, 12.2)
    assert shown_times_s(3.3) == pytest.approx((1.1, 2.2, 3.3))
    assert shown_times_s(0.0) == (0.0,)


def drawn(messages: Iterable[Message], time_s: float) -> Panel:
    """A panel at a time."""
    figure, course = Figure(), gather(messages)
    FigureCanvasAgg(figure)
    panel = Panel(figure.add_subplot(), View(-5.0, 5.0, -5.0, 5.0, points_per_m=30.0), TWO)
    panel.draw(course.poses(), course.estimates(time_s), time_s)
    return panel


def marked(panel: Panel, marker: str) -> list[tuple[float, ...]]:
    marks = [line for line in panel.axes.lines if line.get_marker() == marker]
    return sorted(tuple(np.round(np.concatenate(line.get_data()), 6).tolist()) for line in marks)


def discs(panel: Panel) -> list[tuple[float, ...]]:
    return sorted(
        tuple(round(float(number), 6) for number in (*patch.center, patch.radius))
        for patch in panel.axes.patches
        if hasattr(patch, "center")
    )


def test_a_panel_shows_way_disc_goal_and_estimate_at_its_time() -> None:
    panel = drawn(straight_run(TWO, 8.0), 3.0)
    assert discs(panel) == [(-1, 0, 0.495), (-1, 0, 0.695), (1, 0, 0.495), (1, 0, 0.695)]
    assert marked(panel, GOAL) == [(-4, 0), (4, 0)]
    assert marked(panel, ESTIMATE) == [(0, 0), (0, 0)]
    ways = [line.get_xdata() for line in panel.axes.lines if len(line.get_xdata()) == 31]
    assert [(way[0], round(way[-1], 6)) for way in ways] == [(4, 1), (-4, -1)]


def test_the_tip_points_along_the_heading() -> None:
    state = {"x_m": 1.0, "y_m": 2.0, "heading_rad": np.pi / 2.0, "speed_mps": 0.0}
    panel = drawn([truth(0, {"1": {"state": state}})], 0.0)
    [tip] = [patch.get_xy() for patch in panel.axes.patches if not hasattr(patch, "center")]
    assert tip[:, 1].max() > 2.495, "it reaches out of the body"
    assert tip[tip[:, 1].argmax(), 0] == pytest.approx(1.0)


def test_observers_of_one_opinion_give_one_mark_and_others_all_theirs() -> None:
    messages = [
        truth(0, {"1": {}, "2": {}}),
        mind("1", 0, {"1": (3.0, 3.0), "2": (1.0, 2.0)}),
        mind("2", 0, {"1": (3.0, 3.001), "2": (1.0, 4.0)}),
    ]
    assert marked(drawn(messages, 0.0), ESTIMATE) == [(1, 2), (1, 4), (3, 3)]


def test_a_robot_that_left_leaves_its_way_without_a_disc() -> None:
    assert len(discs(drawn([truth(0, {"1": {}, "2": {}}), truth(1, {"2": {}})], 0.1))) == 2


def test_estimates_are_those_of_the_shown_time_or_the_last_before() -> None:
    course = gather(mind("1", step, {"2": (float(step), 0.0)}) for step in range(100))
    course.add(mind("1", 100))  # without estimates it hides none
    for time_s, step in ((1.6, 16.0), (3.0, 30.0), (9.9, 99.0), (10.4, 99.0)):
        assert course.estimates(time_s) == {"2": [(step, 0.0)]}


def test_of_a_long_run_only_the_estimates_that_can_be_shown_are_kept() -> None:
    course = gather(mind("1", step, {"2": (float(step), 0.0)}) for step in range(200))
    kept = {course.estimates(0.1 * step)["2"][0][0] for step in range(200)}
    assert len(kept) <= 31 + LATE_STEPS + 1
