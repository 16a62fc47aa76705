"""Inverse optimal control beside an independent set-up of eq. 6, where goals are known, and where none is."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from agent_helpers import LOOSE, SOLVERS, WEIGHTS, cold, euler, problem_of, remembered, scene_of, square
from inverse_oracle import dense_problem, solve_dense

from agent.estimate import inverse_optimal_control
from agent.estimate.goals import ConstantAcceleration
from agent.estimate.inverse_optimal_control import (
    ITERATIONS,
    InverseOptimalControl,
    InverseProblem,
    solve_inverse,
)
from agent.solve.vehicle import Array
from protocol.scene import Horizons

Tracks = dict[str, Array]
STEPS = 15
"""K_E."""
LARGE = square(1000.0)


def drive(random: np.random.Generator, start: tuple[float, ...], states: int) -> Array:
    """A smooth drive within all limits, with some of them met, shape (states, 4)."""
    changes = random.uniform(-1.0, 1.0, (states - 1, 2)).clip(-0.8, 0.8) / 0.8 * [0.05, 0.7]
    return euler(start, np.cumsum(changes, axis=0).clip([-1.57, -3.0], [1.57, 3.0]))


def passing(seed: int) -> Tracks:
    """Four robots that pass one another closely; c came late, d only just."""
    random = np.random.default_rng(seed)
    starts = [(-3.0, 0.0, 0.2, 1.0), (-1.0, -2.0, 1.5, 1.0), (2.0, 1.0, 3.0, 0.5), (-3.0, -2.0, 0.5, 2.0)]
    tracks = {robot: drive(random, start, STEPS + 2) for robot, start in zip("abcd", starts, strict=True)}
    return tracks | {"c": tracks["c"][-9:], "d": tracks["d"][-1:]}


def noisy(seed: int) -> Tracks:
    """As seen by sensors: 2 cm, 0.01 rad and 0.05 m/s."""
    random = np.random.default_rng(seed)
    return {
        robot: track + random.normal(size=track.shape) * [0.02, 0.02, 0.01, 0.05]
        for robot, track in passing(seed).items()
    }


def crossing(first: int, last: int) -> Tracks:
    """Steps of three robots that drive the solution of one joint problem of 30 steps."""
    return {
        robot: track[max(0, first) : last].copy() for robot, track in zip("abc", _crossing(), strict=True)
    }


@cache
def _crossing() -> Array:
    starts = [(-3.0, 0.0, 0.1, 1.0), (0.0, -3.0, 1.5, 1.5), (3.0, 1.0, 3.1, 0.5)]
    goals = [(4.0, 0.9, 0.1, 0.0), (0.1, 4.4, 1.6, 0.0), (-3.8, -0.4, 3.0, 0.0)]
    problem = problem_of(starts, goals)
    return SOLVERS["reference"].solve(problem, cold(problem)).states


def together() -> Tracks:
    tracks = passing(0)
    return tracks | {"b": tracks["a"].copy()}


def all_problems(tracks: Tracks, steps: int = STEPS, **rules) -> dict[str, InverseProblem]:
    scene = scene_of(tracks, horizons=Horizons(estimation_steps=steps), **rules)
    return InverseOptimalControl(scene).problems(remembered(tracks, estimation_steps=steps))


def random_company(robots: int, steps: int) -> Tracks:
    random = np.random.default_rng(11)
    starts = random.uniform(-3.0, 3.0, (robots, 4)) * [1.0, 1.0, 1.0, 0.3]
    return {f"{i:02}": drive(random, tuple(start), steps + 2) for i, start in enumerate(starts)}


CASES: dict[str, tuple[list[Tracks], int]] = {
    "passing": ([passing(seed) for seed in range(6)], STEPS),
    "noisy": ([noisy(seed) for seed in range(6)], STEPS),
    "crossing, from when they meet until they part": (
        [crossing(end - STEPS - 2, end) for end in range(STEPS + 1, 32, 5)],
        STEPS,
    ),
    "one on top of the other": ([together()], STEPS),
    "alone, seen briefly": ([random_company(1, 2)], 2),
    "twelve": ([random_company(12, STEPS)], STEPS),
    "seen for long": ([random_company(2, 40)], 40),
}


@pytest.mark.parametrize(("windows", "steps"), CASES.values(), ids=CASES)
def test_goals_are_those_of_a_public_solver_on_an_independent_set_up(windows, steps):
    """PIQP leaves residuals of 1e-13 here; what W alone decides it finds to 1e-5 m.

    One estimator for all sizes: nothing is compiled again, and robots come and go.
    """
    scene = scene_of(sorted(set().union(*windows)), horizons=Horizons(estimation_steps=steps))
    estimator, compiled, differences = InverseOptimalControl(scene), len(solve_inverse.signatures), []
    for tracks in windows:
        for robot, problem in list(estimator.problems(remembered(tracks, estimation_steps=steps)).items())[
            :3
        ]:
            found, dense = solve_inverse(problem, ITERATIONS), dense_problem(scene, tracks, robot)
            assert found.solved
            assert found.multipliers.min() >= 0.0
            variables = (found.goal_offset, found.multipliers, found.terminal_multipliers)
            np.testing.assert_allclose(dense.residual(*variables), 0.0, atol=1e-8 * max(1.0, steps / STEPS))
            expected = solve_dense(dense)
            assert dense.objective(*variables) == pytest.approx(
                dense.objective(*expected), rel=1e-8, abs=1e-14
            )
            differences.append(np.abs(found.goal_offset - expected[0]).max())
    assert np.median(differences) < 1e-8
    assert max(differences) < 1e-5
    assert len(solve_inverse.signatures) == max(compiled, 1)


def test_the_iterations_allowed_are_at_least_twice_those_ever_needed():
    for tracks in [each(seed) for each in (passing, noisy) for seed in range(12)]:
        for rules in ({}, {"limits": LOOSE, "area": LARGE}):
            for problem in all_problems(tracks, **rules).values():
                assert solve_inverse(problem, ITERATIONS // 2).solved


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("field", ["states", "values", "bearings", "weights"])
def test_what_is_not_finite_leaves_the_problem_unsolved(field, value):
    problem = all_problems(passing(0))["a"]
    spoiled = getattr(problem, field).copy()
    spoiled[tuple(size // 2 for size in spoiled.shape)] = value
    assert not solve_inverse(problem._replace(**{field: spoiled}), ITERATIONS).solved


def test_standing_needs_no_multipliers_and_its_goal_is_where_the_robot_stands():
    tracks = passing(0) | {"a": np.tile([1.0, -2.0, 0.4, 0.0], (STEPS + 2, 1))}
    solution = solve_inverse(all_problems(tracks)["a"], ITERATIONS)
    assert solution.solved
    assert not any(each.any() for each in solution[:3])


def optimal_window(at: tuple[float, ...], goal: tuple[float, ...], weights=WEIGHTS) -> Tracks:
    """States (K_E + 1, 4) that are optimal for a goal with a free end, nothing in the way and no limit met.

    The stage costs up to K_E − 1 are all that eq. 2 has beside its fixed end, so all multipliers vanish.
    """
    problem = problem_of([at], [goal], limits=LOOSE, area_m=1000.0, weights=weights, steps=STEPS - 1)
    start = replace(cold(problem), inputs=np.tile([0.2, 0.0], (1, problem.steps, 1)))
    inputs = SOLVERS["reference"].solve(problem, start).inputs[0]
    return {"a": euler(at, [*inputs, (0.0, 0.0)])}


@pytest.mark.parametrize(
    ("start", "goal", "weights"),
    [
        ((0.0, 0.0, 0.3, 2.0), (3.0, 2.0, 0.9, 0.0), WEIGHTS),
        ((-2.0, 1.0, 2.0, 1.0), (-4.0, 4.0, 1.5, 0.0), WEIGHTS),
        ((0.0, 0.0, 0.3, 2.0), (3.0, 2.0, 0.9, 0.0), (1.0, 2.0, 0.5, 0.1)),
    ],
)
def test_the_goal_of_a_drive_that_is_optimal_and_meets_no_limit_is_recovered(start, goal, weights):
    """With the weights of the scene, and inside the area only."""
    memory = remembered(optimal_window(start, goal, weights))
    rules = {"limits": LOOSE, "weights": dict(zip(("x", "y", "heading", "speed"), weights, strict=True))}
    estimate = InverseOptimalControl(scene_of("a", area=LARGE, **rules)).estimate(memory)["a"]
    assert estimate == pytest.approx(goal, abs=0.01)
    estimate = InverseOptimalControl(scene_of("a", area=square(2.5), **rules)).estimate(memory)["a"]
    assert abs(estimate[0]) == 2.5
    assert abs(estimate[1]) <= 2.5


@pytest.mark.parametrize("company", [1, 2, 8])
def test_standing_robots_and_robots_at_their_limits_have_estimates(company):
    """Some stand, in part on one another; one drives along the border, as fast as it can."""
    random = np.random.default_rng(company)
    tracks = {str(i): np.tile([*random.normal(size=3), 0.0], (STEPS + 2, 1)) for i in range(company)}
    x = -9.0 + 0.45 * np.arange(STEPS + 2)
    tracks["0"] = np.column_stack([x, np.full_like(x, 10.0), np.zeros_like(x), np.full_like(x, 4.5)])
    tracks[str(company - 1)][:5] = tracks["0"][:5]
    assert all(solve_inverse(problem, ITERATIONS).solved for problem in all_problems(tracks).values())
    estimates = np.array([*InverseOptimalControl(scene_of(tracks)).estimate(remembered(tracks)).values()])
    assert np.isfinite(estimates).all()
    assert (np.abs(estimates[:, :2]) <= 10.0).all()


@pytest.mark.parametrize(
    "flaw", ["seen for one step", "seen too briefly", "one of them", "no number", "unsolved", ""]
)
def test_where_there_is_no_solution_the_constant_acceleration_model_stands_in(monkeypatch, flaw):
    """A position that is no number belongs to everybody's constraints."""
    tracks, simply = crossing(0, STEPS + 1), "abc"
    if flaw == "seen for one step":
        tracks = crossing(0, 1)
    elif flaw == "seen too briefly":
        tracks = crossing(0, STEPS)
    elif flaw == "one of them":
        tracks["c"], simply = tracks["c"][1:], "c"
    elif flaw == "no number":
        tracks["b"][8, 0] = math.nan
    elif flaw == "unsolved":
        monkeypatch.setattr(inverse_optimal_control, "ITERATIONS", 1)
    else:
        simply = ""
    scene, memory = scene_of("abc"), remembered(tracks)
    expected = ConstantAcceleration(scene).estimate(memory)
    estimates = InverseOptimalControl(scene).estimate(memory)
    assert np.isfinite([*estimates.values()]).all()
    assert {robot for robot in "abc" if (estimates[robot] == expected[robot]).all()} == set(simply)
