"""Where solvers start, always within the limits, and which of several local optima is taken."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from agent_helpers import NEVER, SOLVERS, STEP_S, assert_inputs_within_limits, cold, problem_of
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.solve import Deadline
from agent.solve.multistart import (
    NEAR_GOAL_M,
    SIDESTEP_RADPS,
    best_solution,
    cold_starts,
    escapes,
    is_deadlock,
)
from agent.solve.problem import JointProblem, Solution, Start, braking_inputs, within_limits
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


@settings(max_examples=20)
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
    for robot, allowed in enumerate(problem.limits):
        if allowed.turn_acceleration_radps2 * STEP_S * problem.steps >= 2 * allowed.turn_rate_radps:
            assert np.isclose(left[robot, -1], min(SIDESTEP_RADPS, allowed.turn_rate_radps))
    np.testing.assert_array_equal(alternating[::2], left[::2])
    np.testing.assert_array_equal(alternating[1::2], right[1::2])
    np.testing.assert_array_equal(straight, braking_inputs(problem)[:, :, 0])


@settings(max_examples=20)
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


@settings(max_examples=20)
@given(driving(), st.integers(0, 2**32 - 1))
def test_any_inputs_are_brought_within_the_limits(problem, seed):
    wild = np.random.default_rng(seed).normal(scale=3.0, size=(len(problem.states), problem.steps, 2))
    inputs = within_limits(problem, wild)
    assert_inputs_within_limits(problem, inputs)
    np.testing.assert_allclose(within_limits(problem, inputs), inputs, atol=ROUNDING)


@settings(max_examples=20)
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


PROBLEM = problem_of([(-4.0, 0.0, 0.0, 1.0), (4.0, 2.0, math.pi, 1.0)], [(4, 0, 0, 0), (-4, 2, math.pi, 0)])


def solution(objective: float, *, solved=True, violation_m=0.0, deadlock=False) -> Solution:
    """Robots that go straight on, or stand face to face."""
    inputs, forces = np.zeros((2, 30, 2)), np.zeros((2, 31, 2))
    states = PROBLEM.rollout(inputs)
    if deadlock:
        states[:, :, :2] = [[[-0.7, 0.0]], [[0.7, 0.0]]]
        forces[:, -1, 0] = (-5.0, 5.0)
    limit_multipliers = np.zeros((2, 30, 5))
    return Solution(inputs, states, forces, limit_multipliers, objective, violation_m, solved, iterations=1)


class Canned:
    """Answers the starts in their order."""

    def __init__(self, answers: Sequence[Solution]) -> None:
        self.left = list(answers)

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        return self.left.pop(0)


def chosen(answers: Sequence[Solution], deadline: Deadline = NEVER) -> int:
    """Index of the answer that is taken."""
    best = best_solution(Canned(answers), PROBLEM, [cold(PROBLEM)] * len(answers), deadline)
    return [answer is best for answer in answers].index(True)


CHOICES: dict[str, tuple[list[Solution], int]] = {
    "lowest objective": ([solution(100.0), solution(90.0), solution(95.0)], 1),
    "nearly equal, so the preferred one": ([solution(100.0), solution(99.5)], 0),
    "better by more than a hundredth": ([solution(100.0), solution(98.5)], 1),
    "each compared with the best so far": (
        [solution(100.0), solution(99.5), solution(99.2), solution(98.9)],
        3,
    ),
    "solved before unsolved": ([solution(100.0, solved=False), solution(900.0)], 1),
    "unsolved after solved": ([solution(900.0), solution(100.0, solved=False)], 0),
    "going on before a deadlock": ([solution(100.0, deadlock=True), solution(900.0)], 1),
    "deadlock after going on": ([solution(900.0), solution(100.0, deadlock=True)], 0),
    "solved deadlock before unsolved": ([solution(100.0, solved=False), solution(900.0, deadlock=True)], 1),
    "kept distances before broken ones": ([solution(100.0, violation_m=0.5), solution(900.0)], 1),
    "a rounding error breaks nothing": ([solution(100.0, violation_m=1e-9), solution(101.0)], 0),
    "none solved": ([solution(100.0, solved=False), solution(100.0, solved=False)], 0),
    "no number first": ([solution(math.nan, solved=False), solution(100.0)], 1),
    "no number last": ([solution(100.0), solution(math.nan, solved=False)], 0),
}


@pytest.mark.parametrize(("answers", "best"), CHOICES.values(), ids=CHOICES)
def test_the_best_is_taken(answers, best):
    assert chosen(answers) == best


def test_after_the_deadline_no_further_start_is_tried_but_the_first_one_always_is():
    times = iter([0.0, 1.0, 2.0, 3.0])
    deadline = Deadline(lambda: next(times), 1.5)
    answers = [solution(100.0), solution(90.0), solution(10.0)]
    deadline.begin()
    assert chosen(answers, deadline) == 1
    assert chosen(answers, deadline) == 0


def test_robots_that_stand_for_another_reason_are_not_deadlocked():
    standing = solution(1.0, deadlock=True)
    assert is_deadlock(PROBLEM, standing)
    unhindered = replace(standing, forces=np.zeros((2, 31, 2)))
    assert not is_deadlock(PROBLEM, unhindered)
    goals = standing.states[:, -1] + [NEAR_GOAL_M / 2, 0.0, 0.0, 0.0]
    assert not is_deadlock(replace(PROBLEM, goals=goals), standing)
    creeping = standing.states.copy()
    creeping[:, -5:, 1] += 0.1
    assert not is_deadlock(PROBLEM, replace(standing, states=creeping))


@pytest.mark.parametrize(("first", "best"), [(solution(900.0, deadlock=True), 1), (solution(900.0), 0)])
def test_escapes_are_tried_only_from_a_deadlock(first, best):
    answers = [first, solution(100.0)]
    start = cold(PROBLEM)
    found = best_solution(Canned(answers), PROBLEM, [start], NEVER, lambda _problem: [start])
    assert found is answers[best]


@pytest.mark.parametrize(
    ("state", "goal", "parked"),
    [
        ((-2.98, 1.93, 0.65, 0.0), (-2.88, -2.96, 0.28, 0.0), (-3.78, 0.79)),
        ((-1.6, 0.0, 0.27, 0.0), (3.0, -0.46, 0.0, 0.0), (0.0, -0.28)),
    ],
)
def test_a_robot_that_would_stand_before_a_parked_one_for_good_turns_away_from_it(state, goal, parked):
    problem = problem_of([state], [goal], obstacles=np.tile(parked, (1, 31, 1)))
    solver, straight = SOLVERS["realtime"], cold_starts(problem)[3]
    assert is_deadlock(problem, best_solution(solver, problem, [straight], NEVER))
    best = best_solution(solver, problem, [straight], NEVER, escapes)
    assert not is_deadlock(problem, best)
    assert best.violation_m < 1e-3
