"""Situations that no plan leads into, but noise, disturbances and other robots do, still have a solution."""

import math

import numpy as np
import pytest
from agent_helpers import SAFETY_M, SOLVERS, STEP_S, cold, problem_of
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agent.solve import reference
from agent.solve.problem import JointProblem, JointSolver
from agent.solve.reference import ReferenceSolver

OPPOSITE = [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)]


@pytest.fixture(params=SOLVERS, scope="module")
def solver(request: pytest.FixtureRequest) -> JointSolver:
    return SOLVERS[request.param]


def assert_inputs_within_limits(problem: JointProblem, inputs: np.ndarray) -> None:
    """From previous inputs outside the limits, the first change starts at the limit."""
    held = problem.previous_inputs.clip([-1.57, -3.0], [1.57, 3.0])
    changes = np.diff(np.concatenate([held[:, None], inputs], axis=1), axis=1)
    assert (np.abs(inputs) <= [1.57 + 1e-9, 3.0 + 1e-9]).all()
    assert (np.abs(changes) <= [0.05 + 1e-9, 0.7 + 1e-9]).all()


@pytest.mark.parametrize(
    ("states", "previous"),
    [
        ([(-0.5, 0.0, 0.0, 1.0), (0.5, 0.1, math.pi, 1.0)], None),
        ([(0.0, 0.0, 0.0, 0.0), (0.0, 1e-3, math.pi, 0.0)], None),
        ([(-11.0, 0.0, 0.0, 0.0), (4.0, 0.0, math.pi, 1.0)], None),
        ([(-9.0, 0.0, math.pi, 4.0), (4.0, 11.0, 1.0, 2.0)], None),
        ([(-4.0, 0.0, 0.0, 5.5), (4.0, 0.0, math.pi, -4.8)], None),
        ([(-4.0, 0.0, 0.0, 4.5), (4.0, 0.0, math.pi, -4.5)], [(0.0, 3.0), (0.0, -3.0)]),
        ([(-4.0, 0.0, 0.0, 1.0), (4.0, 0.0, math.pi, 1.0)], [(3.0, 5.0), (-2.0, -15.0)]),
    ],
    ids=[
        "closer than the safety distance",
        "one on top of the other",
        "outside the area",
        "on the way out of it",
        "faster than allowed",
        "too fast to keep the limit",
        "previous inputs outside the limits",
    ],
)
def test_it_still_solves_within_the_limits_of_the_vehicles(solver, states, previous):
    problem = problem_of(states, OPPOSITE, previous=previous)
    solution = solver.solve(problem, cold(problem))
    assert solution.solved
    assert_inputs_within_limits(problem, solution.inputs)
    np.testing.assert_array_equal(solution.states, problem.rollout(solution.inputs))


def test_robots_that_are_too_close_move_apart(solver):
    problem = problem_of([(-0.5, 0.0, 0.0, 0.0), (0.5, 0.1, math.pi, 0.0)], OPPOSITE)
    solution = solver.solve(problem, cold(problem))
    gaps = np.linalg.norm(solution.states[0, :, :2] - solution.states[1, :, :2], axis=1)
    assert solution.violation_m == pytest.approx(SAFETY_M - gaps[2:].min())
    assert solution.violation_m > 0.3
    assert gaps[-1] >= SAFETY_M - 1e-6


def test_a_robot_outside_the_area_comes_back(solver):
    problem = problem_of([(-11.0, 0.0, 0.0, 0.0)], [(0.0, 0.0, 0.0, 0.0)])
    states = solver.solve(problem, cold(problem)).states[0]
    assert (np.diff(states[:, 0]) >= -1e-9).all()
    assert states[-1, 0] > -10.0


def test_a_robot_that_is_too_fast_slows_down_as_soon_as_it_can(solver):
    problem = problem_of([(-8.0, 0.0, 0.0, 6.0)], [(8.0, 0.0, 0.0, 0.0)])
    speeds = solver.solve(problem, cold(problem)).states[0, :, 3]
    braking = np.cumsum([0.07, 0.14, 0.21, 0.28, 0.3, 0.3])
    np.testing.assert_allclose(speeds[1:5], 6.0 - braking[:4], atol=1e-4)
    assert (speeds[12:] <= 4.5 + 1e-6).all()


# No interior-point method promises to solve all of them, so the examples are the same each time. In a trial,
# 3500 others were solved.
@settings(max_examples=25, derandomize=True)
# Out of the area or beyond its border at full speed: braking is almost the only solution.
@example(956275)
@example(230)
@example(1084)
@example(2285)
@given(st.integers(0, 2**32 - 1))
def test_whatever_was_observed_there_is_a_solution(solver, seed):
    """One robot anywhere, at any speed, after any input, with another on its way."""
    random = np.random.default_rng(seed)
    state = random.uniform([-11.0, -11.0, -math.pi, -6.0], [11.0, 11.0, math.pi, 6.0])
    obstacle = random.uniform(-5, 5, 2) + STEP_S * np.outer(np.arange(31), random.uniform(-2, 2, 2))
    problem = problem_of(
        [state],
        [random.uniform([-9.0, -9.0, -math.pi, 0.0], [9.0, 9.0, math.pi, 0.0])],
        previous=[random.uniform([-3.0, -6.0], [3.0, 6.0])],
        obstacles=obstacle[None],
    )
    solution = solver.solve(problem, cold(problem))
    assert solution.solved
    assert_inputs_within_limits(problem, solution.inputs)


def test_a_solver_that_gives_up_says_so_and_its_inputs_still_obey_the_limits(monkeypatch):
    monkeypatch.setitem(reference.IPOPT_OPTIONS, "ipopt.max_iter", 2)
    problem = problem_of([(-4.0, 0.0, 0.0, 0.0), (4.0, 0.0, math.pi, 0.0)], OPPOSITE)
    solution = ReferenceSolver().solve(problem, cold(problem))
    assert not solution.solved
    assert solution.iterations == 2
    assert_inputs_within_limits(problem, solution.inputs)


def test_a_problem_with_a_value_that_is_no_number_is_not_solved(solver):
    problem = problem_of([(-4.0, 0.0, 0.0, 0.0)], [(math.nan, 0.0, 0.0, 0.0)])
    solution = solver.solve(problem, cold(problem))
    assert not solution.solved
    assert_inputs_within_limits(problem, solution.inputs)
