"""The real-time solver as a whole: against the reference, within its bounds, and whatever it is given."""

from dataclasses import fields, replace

import numpy as np
import pytest
from agent_helpers import NEVER, SOLVERS, assert_inputs_within_limits, cold, enlarged, problem_of
from hypothesis import given, settings
from hypothesis import strategies as st
from realtime_helpers import closed_loop, random_crossing

from agent.solve import Deadline
from agent.solve.problem import JointProblem, Solution, Start, clip_stages
from agent.solve.realtime.profiles import inputs_of, states_of
from agent.solve.realtime.sequential import improve
from agent.solve.realtime.solver import COLD_ITERATIONS, RealTimeSolver
from protocol.vehicle import Limits

PASSING = np.column_stack([np.zeros(31), -2.0 + 0.12 * np.arange(31)])
"""Positions of an obstacle."""


def crossing(robots: int = 4, seed: int = 2) -> JointProblem:
    """With an obstacle that passes through the middle."""
    return random_crossing(robots, seed, obstacles=PASSING[None].copy())


def solve(problem: JointProblem, start: Start | None = None, iterations: int = 2) -> Solution:
    return RealTimeSolver(iterations, NEVER).solve(problem, start or cold(problem))


def assert_same(one: Solution, other: Solution) -> None:
    for field in fields(Solution):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_recorded_problems_are_solved_as_by_the_reference():
    """In the same local optimum, which both of them find from the same trajectories."""
    pushed = 0
    for robots, seed in ((2, 0), (3, 1), (4, 2)):
        for each in list(closed_loop(random_crossing(robots, seed), 14))[3::5]:
            start = replace(each.start, warm=False)
            found, expected = (solver.solve(each.problem, start) for solver in SOLVERS.values())
            assert found.solved
            assert expected.solved
            assert found.objective == pytest.approx(expected.objective, rel=2e-5)
            assert found.violation_m < 1e-5
            np.testing.assert_allclose(found.inputs[:, 0], expected.inputs[:, 0], atol=0.02)
            np.testing.assert_allclose(found.states[:, :, :2], expected.states[:, :, :2], atol=0.1)
            pushed += bool(found.forces.any())
    assert pushed >= 3, "distances are meant to matter"


def narrowed(problem: JointProblem, random: np.random.Generator, widths: np.ndarray) -> JointProblem:
    """With other weights at each stage, and bounds of the first inputs within reach, of these widths.

    Widths (M, 2) are in parts of what is in reach, and infinite where nothing is bounded.
    """
    stages = 10.0 ** random.uniform(-1.0, 1.0, (problem.steps + 1, 1))
    held = np.clip(problem.previous_inputs, -problem.input_bounds, problem.input_bounds)
    lowest = np.maximum(held - problem.rate_bounds, -problem.input_bounds)
    highest = np.minimum(held + problem.rate_bounds, problem.input_bounds)
    reach, share = highest - lowest, random.uniform(size=widths.shape)
    width = np.where(np.isfinite(widths), widths, 0.0) * reach
    low = lowest + share * (reach - width)
    bounds = np.where(np.isfinite(widths), [low, low + width], [-np.inf + low, np.inf + low])
    return replace(problem, weights=stages * problem.weights, first_inputs=bounds.swapaxes(0, 1))


def assert_begins_within_bounds(problem: JointProblem, inputs: np.ndarray) -> None:
    assert (inputs[:, 0] >= problem.first_inputs[:, 0]).all()
    assert (inputs[:, 0] <= problem.first_inputs[:, 1]).all()


@pytest.mark.parametrize("width", [0.0, 0.1, np.inf])
def test_weights_of_stages_and_bounds_of_first_inputs_are_taken_as_by_the_reference(width):
    """Of one robot; where both bounds are the same, there is one first input left."""
    *_, last = closed_loop(random_crossing(4, 2), 4)
    free, start = last.problem, replace(last.start, warm=False)
    widths = np.array([[width, width], *[[np.inf, np.inf]] * 3])
    problem = narrowed(free, np.random.default_rng(3), widths)
    found, expected = (solver.solve(problem, start) for solver in SOLVERS.values())
    assert found.solved
    assert expected.solved
    assert found.forces.any(), "distances are meant to matter"
    assert found.objective == pytest.approx(expected.objective, rel=1e-3)
    assert found.violation_m < 0.01
    np.testing.assert_allclose(found.inputs[:, 0], expected.inputs[:, 0], atol=1e-3)
    np.testing.assert_allclose(found.states[:, :, :2], expected.states[:, :, :2], atol=0.02)
    assert_begins_within_bounds(problem, found.inputs)
    unbound = replace(problem, first_inputs=free.first_inputs)
    even = replace(unbound, weights=free.weights)
    for other in [unbound, even] if np.isfinite(width) else [even]:
        away = solve(other, start).states - found.states
        assert np.abs(away[:, :, :2]).max() > 0.02, "what is new is meant to matter"


@pytest.mark.parametrize(("robots", "seed"), [(3, 1), pytest.param(5, 3, marks=pytest.mark.slow)])
def test_a_closed_loop_costs_what_it_costs_with_the_reference(robots, seed):
    """Two iterations a step against as many as it takes."""
    problem, costs, ways, pushed = random_crossing(robots, seed), [], [], False
    for solver in SOLVERS.values():
        steps = list(closed_loop(problem, 25, solver))
        ways.append(np.array([step.problem.states for step in steps]))
        costs.append(float((problem.weights[0] * (ways[-1] - problem.goals) ** 2).sum()))
        assert max(step.solution.violation_m for step in steps) < 1e-3
        pushed |= any(step.solution.forces.any() for step in steps)
    assert pushed
    assert np.abs(ways[0] - ways[1])[..., :2].max() < 0.1, "meant to be in the same local minimum"
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)


def test_after_the_deadline_no_iteration_begins_but_the_first_one_always_does():
    times = iter(range(100))
    deadline = Deadline(lambda: float(next(times)), 2.5)
    solver, problem = RealTimeSolver(2, deadline), crossing()
    deadline.begin()
    in_time = solver.solve(problem, cold(problem))
    late = solver.solve(problem, cold(problem))
    assert (in_time.iterations, late.iterations) == (3, 1)
    assert in_time.solved
    assert late.solved
    assert solve(problem).iterations > 3


@settings(max_examples=8)
@given(st.integers(0, 99), st.sampled_from([-6, -1, 3, 6]), st.sampled_from([-7, 0, 10]), st.booleans())
def test_in_other_units_of_length_and_of_cost_the_solution_is_the_same_to_the_last_bit(
    seed, length, cost, warm
):
    """Powers of two round nothing, so any constant in metres or in cost shows."""
    problem = crossing(3, seed)
    problem = replace(problem, sides=np.where(np.eye(3, 4) > 0.0, 0.0, -1.0))
    widths = np.array([[0.5, 0.1], [0.0, 0.0], [np.inf, np.inf]])
    problem = narrowed(problem, np.random.default_rng(seed), widths)
    length, cost = 2.0**length, 2.0**cost
    state = np.array([length, length, 1.0, length])
    longer = {name: length * getattr(problem, name) for name in ("obstacles", "safety_distances", "area")}
    longer |= {name: state * getattr(problem, name) for name in ("states", "goals")}
    longer |= {"first_inputs": state[2:] * problem.first_inputs}
    weights, limits = cost * problem.weights / state**2, (enlarged(length),) * 3
    scaled = replace(problem, **longer, weights=weights, limits=limits)
    found, expected = (solve(each, replace(cold(each), warm=warm)) for each in (scaled, problem))
    assert (found.solved, found.iterations) == (expected.solved, expected.iterations)
    np.testing.assert_array_equal(found.states, expected.states * state)
    np.testing.assert_array_equal(found.forces, expected.forces * cost / length)
    assert found.objective == cost * expected.objective
    assert found.violation_m == length * expected.violation_m


@pytest.mark.parametrize("most", [1, 2, 5])
def test_from_a_warm_start_it_makes_no_more_iterations_than_it_is_told(most):
    problem = crossing()
    start = replace(cold(problem), warm=True)
    assert solve(problem, start, iterations=most).iterations == most
    assert most < solve(problem).iterations <= COLD_ITERATIONS


def test_it_stops_early_where_little_is_left_to_gain():
    converged = solve(crossing())
    again = solve(crossing(), converged.start(), iterations=20)
    assert again.iterations <= 2
    assert again.objective == pytest.approx(converged.objective, rel=1e-4)


FIELDS = ["states", "previous_inputs", "goals", "obstacles", "safety_distances", "area", "weights"]


@pytest.mark.parametrize(
    ("field", "value"), [*((field, np.nan) for field in FIELDS), ("goals", np.inf), ("area", -np.inf)]
)
def test_a_problem_with_a_value_that_is_no_number_is_not_solved(field, value):
    problem = crossing()
    spoiled = getattr(problem, field).copy()
    spoiled[(-1,) * spoiled.ndim] = value
    spoiled = replace(problem, **{field: spoiled})
    for warm in (False, True):
        solution = solve(spoiled, replace(cold(problem), warm=warm))
        assert not solution.solved
        if field != "previous_inputs":  # from which nothing would be within reach
            assert_inputs_within_limits(spoiled, solution.inputs, rounding=1e-15)


@pytest.mark.parametrize("part", ["inputs", "forces"])
def test_a_start_with_a_value_that_is_no_number_leads_to_no_solution(part):
    start = replace(cold(crossing()), warm=True)
    getattr(start, part)[1, 5, 0] = np.nan
    assert not solve(crossing(), start).solved


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 3), st.booleans())
def test_limits_are_kept_exactly_after_any_number_of_iterations(seed, robots, iterations, warm):
    """A command beyond them by a rounding error would be clipped by the world, and counted."""
    random = np.random.default_rng(seed)
    allowed = Limits(speed_mps=2.0, turn_rate_radps=0.7, jerk_mps3=20.0)
    states = random.normal(size=(robots, 4)) * [3.0, 3.0, 2.0, 1.0]
    problem = problem_of(
        states,
        random.normal(size=(robots, 4)) * [4.0, 4.0, 2.0, 0.0],
        previous=random.normal(size=(robots, 2)).tolist(),
        limits=allowed,
        steps=int(random.integers(1, 20)),
    )
    problem = narrowed(problem, random, random.choice([0.0, 0.3, np.inf], (robots, 1)) * np.ones(2))
    wild = random.normal(scale=3.0, size=(robots, problem.steps, 2))
    solution = solve(problem, replace(cold(problem), inputs=wild, warm=warm), iterations)
    assert_begins_within_bounds(problem, solution.inputs)
    assert_inputs_within_limits(problem, solution.inputs, rounding=1e-15)
    np.testing.assert_array_equal(solution.states, problem.rollout(solution.inputs))


def compiled() -> list[list[object]]:
    """What the kernels that the solver calls were compiled for."""
    return [list(kernel.signatures) for kernel in (improve, states_of, inputs_of, clip_stages)]


def test_other_layouts_and_numbers_compile_nothing_and_layouts_change_nothing():
    def strided(values: np.ndarray) -> np.ndarray:
        room = np.full([2 * length for length in values.shape], np.nan)
        view = room[(slice(None, None, 2),) * values.ndim]
        view[...] = values
        return view

    problem = crossing()
    expected, before = solve(problem), compiled()
    for layout in (np.asfortranarray, strided):
        arrays = [*FIELDS, "sides", "first_inputs"]
        other = replace(problem, **{field: layout(getattr(problem, field)) for field in arrays})
        parts = ("inputs", "forces", "limit_multipliers")
        start = replace(cold(problem), **{part: layout(getattr(cold(problem), part)) for part in parts})
        assert_same(solve(other, start), expected)
    for robots, obstacles, steps in ((1, 0, 30), (2, 3, 1), (7, 1, 2), (3, 0, 45)):
        standing = np.tile(PASSING[:1], (obstacles, steps + 1, 1))
        assert solve(random_crossing(robots, 1, obstacles=standing, steps=steps)).solved
    assert compiled() == before
