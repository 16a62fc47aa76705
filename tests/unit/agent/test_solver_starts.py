"""Inputs that solvers start from: always within the limits, and leading where they are meant to."""

from dataclasses import replace

import numpy as np
from agent_helpers import STEP_S, cold, problem_of
from hypothesis import given
from hypothesis import strategies as st

from agent.solve.multistart import SIDESTEP_RADPS, cold_starts, escapes, shifted
from agent.solve.problem import JointProblem, braking_inputs, within_limits
from protocol.vehicle import Limits

ROUNDING = 1e-9
shares = st.floats(-1.0, 1.0, allow_subnormal=False)
limits = st.just(Limits()) | st.builds(
    Limits,
    speed_mps=st.floats(0.5, 6.0),
    acceleration_mps2=st.floats(1.0, 6.0),
    turn_rate_radps=st.floats(0.1, 4.0),
    jerk_mps3=st.floats(3.0, 60.0),
    turn_acceleration_radps2=st.floats(0.1, 20.0),
)


@st.composite
def driving(draw: st.DrawFn) -> JointProblem:
    """One to three robots that drive within their limits."""
    count = draw(st.integers(1, 3))
    allowed = tuple(draw(limits) for _ in range(count))
    states = [(10.0 * i, 0.0, draw(shares), draw(shares) * each.speed_mps) for i, each in enumerate(allowed)]
    previous = [
        (draw(shares) * each.turn_rate_radps, draw(shares) * each.acceleration_mps2) for each in allowed
    ]
    return replace(problem_of(states, np.zeros((count, 4)), previous=previous), limits=allowed)


def assert_inputs_within_limits(problem: JointProblem, inputs: np.ndarray) -> None:
    assert inputs.shape == (len(problem.states), problem.steps, 2)
    for robot, allowed in enumerate(problem.limits):
        bounds = (allowed.turn_rate_radps, allowed.acceleration_mps2)
        rates = np.array([allowed.turn_acceleration_radps2, allowed.jerk_mps3]) * STEP_S
        changes = np.diff(np.vstack([problem.previous_inputs[robot], inputs[robot]]), axis=0)
        assert (np.abs(inputs[robot]) <= np.array(bounds) + ROUNDING).all()
        assert (np.abs(changes) <= rates + ROUNDING).all()


@given(driving())
def test_a_cold_start_is_within_the_limits_and_leans_to_the_left(problem):
    inputs = cold(problem).inputs
    assert_inputs_within_limits(problem, inputs)
    turn_rates = [min(SIDESTEP_RADPS, each.turn_rate_radps) for each in problem.limits]
    reachable = [each.turn_acceleration_radps2 * STEP_S * problem.steps for each in problem.limits]
    for robot, (wanted, change) in enumerate(zip(turn_rates, reachable, strict=True)):
        if change >= 2 * problem.limits[robot].turn_rate_radps:
            assert np.isclose(inputs[robot, -1, 0], wanted)


@given(driving())
def test_cold_starts_lean_left_right_alternately_and_not_at_all_and_expect_no_forces(problem):
    starts = cold_starts(problem)
    for start in starts:
        assert_inputs_within_limits(problem, start.inputs)
        np.testing.assert_array_equal(start.inputs[:, :, 1], braking_inputs(problem)[:, :, 1])
        assert start.forces.shape == (len(problem.states), problem.steps + 1, 2)
        assert not start.forces.any()
        assert start.limit_multipliers.shape == (len(problem.states), problem.steps, 5)
        assert not start.limit_multipliers.any()
        assert not start.warm
    left, right, alternating, straight = (start.inputs[:, :, 0] for start in starts)
    assert (right <= straight).all()
    assert (straight <= left).all()
    assert (right[:, -1] < left[:, -1]).all()
    np.testing.assert_array_equal(alternating[::2], left[::2])
    np.testing.assert_array_equal(alternating[1::2], right[1::2])
    np.testing.assert_array_equal(straight, braking_inputs(problem)[:, :, 0])


@given(driving())
def test_braking_inputs_are_within_the_limits_and_end_at_a_standstill(problem):
    """Given the time that full braking needs: to undo the acceleration, to stop, and to let go."""
    time_s = max(
        2 * each.acceleration_mps2 / each.jerk_mps3
        + (abs(state[3]) + each.acceleration_mps2**2 / each.jerk_mps3) / each.acceleration_mps2
        + 4 * each.acceleration_mps2 / each.jerk_mps3
        + 2 * each.turn_rate_radps / each.turn_acceleration_radps2
        for each, state in zip(problem.limits, problem.states, strict=True)
    )
    problem = replace(problem, steps=int(time_s / STEP_S) + 10)
    inputs = braking_inputs(problem)
    assert_inputs_within_limits(problem, inputs)
    states = problem.rollout(inputs)
    np.testing.assert_allclose(states[:, -1, 3], 0.0, atol=1e-6)
    np.testing.assert_allclose(inputs[:, -1], 0.0, atol=1e-5)


@given(driving(), st.integers(0, 2**32 - 1))
def test_any_inputs_are_brought_within_the_limits(problem, seed):
    wild = np.random.default_rng(seed).normal(scale=3.0, size=(len(problem.states), problem.steps, 2))
    inputs = within_limits(problem, wild)
    assert_inputs_within_limits(problem, inputs)
    np.testing.assert_allclose(within_limits(problem, inputs), inputs, atol=ROUNDING)


def test_inputs_within_the_limits_stay_as_they_are():
    problem = problem_of([(0.0, 0.0, 0.0, 0.0)], [(1.0, 0.0, 0.0, 0.0)], steps=3)
    inputs = np.array([[[0.05, 0.7], [0.0, 0.0], [-0.03, -0.5]]])
    np.testing.assert_array_equal(within_limits(problem, inputs), inputs)


def test_a_shifted_plan_is_a_step_further_and_ends_with_no_input():
    assert shifted(np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])).tolist() == [[3, 4], [5, 6], [0, 0]]


@given(driving())
def test_escapes_turn_as_quickly_as_limits_allow_to_either_side(problem):
    for side, start in zip((1.0, -1.0), escapes(problem), strict=True):
        assert_inputs_within_limits(problem, start.inputs)
        held = problem.previous_inputs[:, 0]
        for k in range(problem.steps):
            held = np.clip(
                held + side * problem.rate_bounds[:, 0],
                -problem.input_bounds[:, 0],
                problem.input_bounds[:, 0],
            )
            np.testing.assert_allclose(start.inputs[:, k, 0], held, atol=ROUNDING)
