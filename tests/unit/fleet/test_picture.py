"""The picture of a run: the right things at the right places, in a readable file."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

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
from fleet.record.recording import Recorder, read_recording
from fleet.record.summary import Tally
from fleet.run.experiment import RunFacts
from protocol.messages import Message
from protocol.scenario import Scenario


def gather(scenario: Scenario, messages: Iterable[Message]) -> Course:
    course = Course(scenario.step_s)
    for message in messages:
        course.add(message)
    return course


def draw(scenario: Scenario, messages: Iterable[Message], facts: RunFacts, path: Path) -> np.ndarray:
    course, tally = Course(scenario.step_s), Tally()
    for message in messages:
        course.add(message)
        tally.add(message)
    draw_paths(scenario, course, tally.summary(facts), path)
    return imread(path)


@pytest.mark.parametrize("robots", [1, 2, 8, 16])
def test_every_robot_leaves_its_colour_in_the_picture(
    tmp_path: Path, facts: RunFacts, make_scenario: Any, make_run: Any, robots: int
) -> None:
    scenario = make_scenario(robots)
    pixels = draw(scenario, make_run(scenario, 5.0), facts, tmp_path / "paths.png")
    assert pixels.shape[1] > 1500
    colours = (np.round(pixels[..., :3] * 255).astype(int) @ (65536, 256, 1)).ravel()
    for colour in COLOURS[:robots]:
        # Three discs at least: far more pixels than a line of text.
        assert np.count_nonzero(colours == int(colour[1:], 16)) > 2000
    assert not np.isin(colours, [int(colour[1:], 16) for colour in COLOURS[robots:]]).any()


def test_a_recording_gives_the_same_picture_as_the_run(
    tmp_path: Path, facts: RunFacts, make_scenario: Any, make_run: Any
) -> None:
    scenario = make_scenario(3)
    messages = list(make_run(scenario, 5.0))
    with Recorder(tmp_path / "run.mcap", facts, "") as recorder:
        for message in messages:
            recorder.record("unspoken/test/anything", message, 0)
    live = draw(scenario, messages, facts, tmp_path / "live.png")
    recorded = (message for _, message in read_recording(tmp_path / "run.mcap"))
    assert np.array_equal(live, draw(scenario, recorded, facts, tmp_path / "later.png"))


@pytest.mark.parametrize("duration_s", [0.0, 0.1, 1.0])
def test_a_run_that_broke_off_early_is_drawn_too(
    tmp_path: Path, facts: RunFacts, make_scenario: Any, make_run: Any, duration_s: float
) -> None:
    scenario = make_scenario(3)
    assert draw(scenario, make_run(scenario, duration_s), facts, tmp_path / "paths.png").size


def test_a_run_without_any_message_shows_the_start(
    tmp_path: Path, facts: RunFacts, make_scenario: Any
) -> None:
    assert draw(make_scenario(2), [], facts, tmp_path / "paths.png").size


def test_a_run_is_shown_at_the_published_times_or_at_its_thirds() -> None:
    assert shown_times_s(12.2) == (1.6, 3.0, 12.2)
    assert shown_times_s(3.3) == pytest.approx((1.1, 2.2, 3.3))
    assert shown_times_s(0.0) == (0.0,)


@pytest.fixture
def panel(make_scenario: Any) -> Panel:
    """A panel of two robots that change places between (4, 0) and (−4, 0)."""
    figure = Figure()
    FigureCanvasAgg(figure)
    return Panel(figure.add_subplot(), View(-5.0, 5.0, -5.0, 5.0, points_per_m=30.0), make_scenario(2))


def marked(panel: Panel, marker: str) -> list[tuple[float, ...]]:
    marks = [line for line in panel.axes.lines if line.get_marker() == marker]
    return [tuple(np.round(np.concatenate(line.get_data()), 6).tolist()) for line in marks]


def discs(panel: Panel) -> list[tuple[float, ...]]:
    return [
        tuple(round(float(number), 6) for number in (*patch.center, patch.radius))
        for patch in panel.axes.patches
        if hasattr(patch, "center")
    ]


def test_a_panel_shows_way_disc_goal_and_estimate_at_its_time(panel: Panel, make_run: Any) -> None:
    course = gather(panel.scenario, make_run(panel.scenario, 8.0))
    panel.draw(course.poses(), course.estimates(3.0), 3.0)
    assert sorted(discs(panel)) == [(-1, 0, 0.495), (-1, 0, 0.695), (1, 0, 0.495), (1, 0, 0.695)]
    assert sorted(marked(panel, GOAL)) == [(-4, 0), (4, 0)]
    assert marked(panel, ESTIMATE) == [(0, 0), (0, 0)]
    ways = [line.get_xdata() for line in panel.axes.lines if len(line.get_xdata()) == 31]
    assert [(way[0], round(way[-1], 6)) for way in ways] == [(4, 1), (-4, -1)]


def test_the_tip_points_along_the_heading(panel: Panel, make_truth: Any) -> None:
    state = {"x_m": 1.0, "y_m": 2.0, "heading_rad": np.pi / 2.0, "speed_mps": 0.0}
    truth = make_truth(0, {"1": {"state": state}})
    course = gather(panel.scenario, [truth])
    panel.draw(course.poses(), {}, 0.0)
    [tip] = [patch.get_xy() for patch in panel.axes.patches if not hasattr(patch, "center")]
    assert tip[:, 1].max() > 2.495, "it reaches out of the body"
    assert tip[tip[:, 1].argmax(), 0] == pytest.approx(1.0)


def test_observers_of_one_opinion_give_one_mark_and_others_all_theirs(
    panel: Panel, make_truth: Any, make_mind: Any
) -> None:
    messages = [
        make_truth(0, {"1": {}, "2": {}}),
        make_mind("1", 0, {"1": (3.0, 3.0), "2": (1.0, 2.0)}),
        make_mind("2", 0, {"1": (3.0, 3.001), "2": (1.0, 4.0)}),
    ]
    course = gather(panel.scenario, messages)
    panel.draw(course.poses(), course.estimates(0.0), 0.0)
    assert sorted(marked(panel, ESTIMATE)) == [(1, 2), (1, 4), (3, 3)]


def test_a_robot_that_left_leaves_its_way_without_a_disc(panel: Panel, make_truth: Any) -> None:
    course = gather(panel.scenario, [make_truth(0, {"1": {}, "2": {}}), make_truth(1, {"2": {}})])
    panel.draw(course.poses(), {}, 0.1)
    assert len(discs(panel)) == 2


def test_estimates_are_those_of_the_shown_time_or_the_last_before(make_scenario: Any, make_mind: Any) -> None:
    course = gather(
        make_scenario(2), [make_mind("1", step, {"2": (float(step), 0.0)}) for step in range(100)]
    )
    assert course.estimates(1.6) == {"2": [(16.0, 0.0)]}
    assert course.estimates(3.0) == {"2": [(30.0, 0.0)]}
    assert course.estimates(9.9) == {"2": [(99.0, 0.0)]}
    assert course.estimates(10.4) == {"2": [(99.0, 0.0)]}


def test_minds_without_estimates_do_not_hide_earlier_ones(make_scenario: Any, make_mind: Any) -> None:
    course = gather(make_scenario(2), [make_mind("1", 5, {"2": (1.0, 1.0)}), make_mind("1", 6)])
    assert course.estimates(0.6) == {"2": [(1.0, 1.0)]}


def test_of_a_long_run_only_the_estimates_that_can_be_shown_are_kept(
    make_scenario: Any, make_mind: Any
) -> None:
    course = gather(
        make_scenario(2), [make_mind("1", step, {"2": (float(step), 0.0)}) for step in range(500)]
    )
    kept = {course.estimates(0.1 * step)["2"][0][0] for step in range(500)}
    assert len(kept) <= 31 + LATE_STEPS + 1
