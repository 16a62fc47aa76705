"""What inverse optimal control makes of observed driving, in cases whose answer is known."""

import math

import numpy as np
import pytest
from agent_helpers import LOOSE, STEP_S, WEIGHTS, remembered, scene_of, square
from inverse_drives import STEPS, crossing, optimal_drives

from agent.estimate import inverse_optimal_control
from agent.estimate.goals import ConstantAcceleration
from agent.estimate.inverse_optimal_control import InverseOptimalControl, solve_inverse
from protocol.vehicle import Limits

LARGE = square(1000.0)


def optimal_window(start: tuple[float, ...], goal: tuple[float, ...], weights=WEIGHTS) -> np.ndarray:
    """States (K_E + 1, 4) that are optimal for a goal with a free end, nothing in the way and no limit met.

    The stage costs up to K_E − 1 are all that eq. 2 has beside its fixed end, so all multipliers vanish.
    """
    optimum = optimal_drives([start], np.array([goal]), steps=STEPS - 1, weights=weights)[0]
    x, y, heading, speed = optimum[-1]
    beyond = (x + STEP_S * speed * math.cos(heading), y + STEP_S * speed * math.sin(heading), heading, speed)
    return np.concatenate([optimum, [beyond]])


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.0, 0.0, 0.3, 2.0), (3.0, 2.0, 0.9, 0.0)),
        ((-2.0, 1.0, 2.0, 1.0), (-4.0, 4.0, 1.5, 0.0)),
    ],
)
def test_the_goal_of_a_drive_that_is_optimal_and_meets_no_limit_is_recovered(start, goal):
    scene = scene_of("a", limits=LOOSE, area=LARGE)
    window = optimal_window(start, goal)
    estimate = InverseOptimalControl(scene).estimate(remembered({"a": window}))["a"]
    assert estimate == pytest.approx(goal, abs=0.01)


def test_the_goal_is_recovered_with_the_weights_of_the_scene():
    """A drive that was optimal for other weights gives another goal."""
    goal, weights = (3.0, 2.0, 0.9, 0.0), (1.0, 2.0, 0.5, 0.1)
    memory = remembered({"a": optimal_window((0.0, 0.0, 0.3, 2.0), goal, weights)})
    names = ("x", "y", "heading", "speed")
    right = scene_of("a", limits=LOOSE, area=LARGE, weights=dict(zip(names, weights, strict=True)))
    wrong = scene_of("a", limits=LOOSE, area=LARGE)
    assert InverseOptimalControl(right).estimate(memory)["a"] == pytest.approx(goal, abs=0.01)
    assert np.linalg.norm(InverseOptimalControl(wrong).estimate(memory)["a"][:2] - goal[:2]) > 0.1


@pytest.mark.parametrize("company", [1, 2, 8])
def test_standing_robots_and_robots_at_their_limits_have_estimates(company):
    """Some stand, in part on one another; one drives along the border, as fast as it can."""
    random = np.random.default_rng(company)
    tracks = {str(i): np.tile([*random.normal(size=3), 0.0], (STEPS + 2, 1)) for i in range(company)}
    x = -9.0 + 0.45 * np.arange(STEPS + 2)
    tracks["0"] = np.column_stack([x, np.full_like(x, 10.0), np.zeros_like(x), np.full_like(x, 4.5)])
    tracks[str(company - 1)][:5] = tracks["0"][:5]
    scene = scene_of(tracks)
    for robot, estimate in InverseOptimalControl(scene).estimate(remembered(tracks)).items():
        assert np.isfinite(estimate).all(), robot
        assert (np.abs(estimate[:2]) <= 10.0).all()
        assert solve_inverse(InverseOptimalControl(scene).problems(remembered(tracks))[robot], 100).solved


def test_a_robot_that_drives_straight_is_going_straight_ahead():
    """By symmetry: nothing distinguishes its left from its right."""
    heading = 0.8
    direction = np.array([math.cos(heading), math.sin(heading)])
    start = (*(-3.0 * direction), heading, 0.0)
    goal = (*(4.0 * direction), heading, 0.0)
    window = optimal_drives([start], np.array([goal]), steps=30, limits=Limits())[0][: STEPS + 1]
    scene = scene_of("a", area=LARGE)
    estimate = InverseOptimalControl(scene).estimate(remembered({"a": window}))["a"]
    ahead = estimate[:2] - window[-1, :2]
    assert ahead @ direction > 0.5
    assert ahead @ [-direction[1], direction[0]] == pytest.approx(0.0, abs=1e-3)
    assert estimate[2:] == pytest.approx([heading, 0.0], abs=1e-3)


def test_turning_and_moving_the_whole_scene_turns_and_moves_the_estimates():
    tracks = crossing()
    angle, shift = 2.1, np.array([7.0, -5.0])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = {
        robot: np.column_stack([track[:, :2] @ turn.T + shift, track[:, 2] + angle, track[:, 3]])
        for robot, track in tracks.items()
    }
    scene = scene_of("abc", area=LARGE)
    here, there = (InverseOptimalControl(scene).estimate(remembered(each)) for each in (tracks, moved))
    for robot in "abc":
        expected = [*(turn @ here[robot][:2] + shift), here[robot][2] + angle, 0.0]
        assert there[robot] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("tracks", "simply"),
    [
        ({robot: track[:1] for robot, track in crossing().items()}, "abc"),
        ({robot: track[:STEPS] for robot, track in crossing().items()}, "abc"),
        (crossing() | {"c": crossing()["c"][-STEPS:]}, "c"),
        (crossing(), ""),
    ],
)
def test_until_a_robot_was_seen_for_enough_steps_the_constant_acceleration_model_stands_in(tracks, simply):
    scene, memory = scene_of("abc"), remembered(tracks)
    expected = ConstantAcceleration(scene).estimate(memory)
    estimates = InverseOptimalControl(scene).estimate(memory)
    assert {robot for robot in "abc" if (estimates[robot] == expected[robot]).all()} == set(simply)


@pytest.mark.parametrize("flaw", ["too few iterations", "no number"])
def test_a_program_that_is_not_solved_leaves_the_constant_acceleration_estimate(monkeypatch, flaw):
    """A position that is no number belongs to everybody's constraints."""
    tracks = crossing()
    if flaw == "no number":
        tracks["b"][8, 0] = math.nan
    else:
        monkeypatch.setattr(inverse_optimal_control, "ITERATIONS", 1)
    scene, memory = scene_of("abc"), remembered(tracks)
    expected = ConstantAcceleration(scene).estimate(memory)
    for robot, estimate in InverseOptimalControl(scene).estimate(memory).items():
        np.testing.assert_array_equal(estimate, expected[robot])
        assert np.isfinite(estimate).all()


def test_goals_are_looked_for_inside_the_area_only():
    window = optimal_window((0.0, 0.0, 0.3, 2.0), (3.0, 2.0, 0.9, 0.0))
    scene = scene_of("a", limits=LOOSE, area=square(2.5))
    estimate = InverseOptimalControl(scene).estimate(remembered({"a": window}))["a"]
    assert estimate[0] == 2.5
    assert abs(estimate[1]) <= 2.5
