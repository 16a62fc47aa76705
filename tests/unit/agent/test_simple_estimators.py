"""Exchanged goals and the constant-acceleration model."""

import math

import numpy as np
import pytest
from agent_helpers import STEP_S, euler, remembered, scene_of, square
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.estimate import ESTIMATORS
from agent.estimate.goals import ConstantAcceleration, Exchanged
from protocol.scene import Goal
from protocol.vehicle import Limits

STANDING = (1.0, -2.0, 0.4, 0.0)
LARGE = square(1000.0)


def after(speed: float, acceleration: float, heading: float = 0.0) -> np.ndarray:
    """Two states of a robot now at the origin, the input between them being this acceleration."""
    before = speed - STEP_S * acceleration
    way = STEP_S * before
    return np.array(
        [[-way * math.cos(heading), -way * math.sin(heading), heading, before], [0.0, 0.0, heading, speed]]
    )


def estimate(track: np.ndarray, **scene) -> np.ndarray:
    return ConstantAcceleration(scene_of("a", **scene)).estimate(remembered({"a": track}))["a"]


def test_exchanged_goals_are_those_of_the_scene_on_the_turn_nearest_to_the_robot():
    goal = Goal(x_m=4.0, y_m=-4.0, heading_rad=-2.5)
    scene = scene_of("ab", goals={"a": goal, "b": goal})
    turning = np.array([(0.0, 0.0, heading, 0.0) for heading in np.linspace(0.0, 9.0, 10)])
    estimates = Exchanged(scene).estimate(remembered({"a": np.array([STANDING]), "b": turning}))
    assert estimates["a"].tolist() == [4.0, -4.0, -2.5, 0.0]
    assert estimates["b"].tolist() == pytest.approx([4.0, -4.0, -2.5 + 2 * math.tau, 0.0])


def test_a_robot_whose_goal_nobody_told_is_taken_to_stay():
    scene = scene_of("a", goals={"a": Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)})
    estimates = Exchanged(scene).estimate(remembered({"stranger": np.array([(1.0, -2.0, 0.4, 3.0)])}))
    assert estimates["stranger"].tolist() == [1.0, -2.0, 0.4, 0.0]


def test_exchanged_goals_need_a_scene_with_goals_and_say_how_to_get_one():
    with pytest.raises(ValueError, match="--exchange-goals"):
        Exchanged(scene_of("a"))


def test_only_exchanged_goals_are_shared():
    scene = scene_of("a", goals={})
    shared = {name for name, estimator in ESTIMATORS.items() if estimator(scene).goals_are_shared}
    assert shared == {"exchanged"}


@settings(max_examples=30)
@given(st.floats(-6.0, 6.0), st.floats(-4.0, 4.0), st.floats(-3.0, 3.0), st.integers(2, 40))
def test_speeding_up_takes_the_most_that_jerk_acceleration_and_speed_limit_leave(
    speed, acceleration, heading, steps
):
    """Straight on, forwards or in reverse, step by step through the model, also from beyond the limits."""
    horizons = {"prediction_steps": steps, "estimation_steps": 3}
    limits = Limits(speed_mps=4.0, acceleration_mps2=2.5, jerk_mps3=6.0)
    goal = estimate(after(speed, acceleration, heading), area=LARGE, horizons=horizons, limits=limits)
    direction = -1.0 if speed < 0.0 else 1.0
    inputs, ahead, forward = [], direction * speed, direction * acceleration
    for _ in range(steps):
        forward = min(forward + 0.6, 2.5, (4.0 - ahead) / STEP_S)
        ahead += STEP_S * forward
        inputs.append((0.0, direction * forward))
    end = euler((0.0, 0.0, heading, speed), inputs)[-1]
    np.testing.assert_allclose(goal, [*end[:2], heading, 0.0], atol=1e-9)


def test_a_turning_robot_is_expected_to_go_straight_on():
    turning = np.array([(0.0, 0.0, 0.0, 1.0), (0.1, 0.0, 0.2, 1.0)])
    goal = estimate(turning, area=LARGE)
    direction = math.atan2(goal[1], goal[0] - 0.1)
    assert (direction, goal[2]) == pytest.approx((0.2, 0.2))


def test_the_estimate_is_moved_into_the_area():
    corner = np.array([(8.0, -9.0, -math.pi / 4, 3.0)])
    assert estimate(corner) == pytest.approx([10.0, -10.0, -math.pi / 4, 0.0])
    beyond = np.array([(-12.0, 0.0, math.pi, 0.0)])
    assert estimate(beyond)[:2] == pytest.approx([-10.0, 0.0], abs=1e-9)
