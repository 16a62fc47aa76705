"""Eq. 6 beside an independent set-up and public QP libraries, and where it must be unsolved or trivial."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from agent_helpers import LOOSE, STEP_S, remembered, scene_of, square
from inverse_drives import STEPS, crossing, drive, passing
from inverse_oracle import DenseProblem, dense_problem, solve_dense

from agent.estimate.inverse_optimal_control import (
    FIRST_DISTANCE,
    ITERATIONS,
    InverseOptimalControl,
    InverseProblem,
    InverseSolution,
    solve_inverse,
)
from protocol.scene import Horizons, Scene

Tracks = dict[str, np.ndarray]


def solution_of(tracks: Tracks, robot: str = "a", scene: Scene | None = None) -> InverseSolution:
    scene = scene or scene_of(tracks)
    memory = remembered(tracks, estimation_steps=scene.horizons.estimation_steps)
    return solve_inverse(InverseOptimalControl(scene).problems(memory)[robot], ITERATIONS)


def variables(solution: InverseSolution) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return solution.goal_offset, solution.multipliers, solution.terminal_multipliers


def windows_of_a_crossing() -> Iterator[Tracks]:
    """Windows of three robots from when they meet until they part."""
    tracks = crossing(steps=30)
    for end in range(STEPS + 1, 32, 5):
        yield {robot: track[max(0, end - STEPS - 2) : end] for robot, track in tracks.items()}


def noisy(tracks: Tracks, seed: int) -> Tracks:
    """As seen by sensors: 2 cm, 0.01 rad and 0.05 m/s."""
    random = np.random.default_rng(seed)
    return {
        robot: track + random.normal(size=track.shape) * [0.02, 0.02, 0.01, 0.05]
        for robot, track in tracks.items()
    }


PASSING = [passing(seed) for seed in range(30)]
NOISY = [noisy(passing(seed), seed) for seed in range(20)]


def all_problems(tracks: Tracks) -> dict[str, InverseProblem]:
    return InverseOptimalControl(scene_of(tracks)).problems(remembered(tracks))


def assert_same(found: list[InverseSolution], dense: list[DenseProblem]) -> None:
    """PIQP leaves residuals of 1e-13 here; what W alone decides it finds to 1e-5 m."""
    differences = []
    for solution, problem in zip(found, dense, strict=True):
        assert solution.solved
        np.testing.assert_allclose(problem.residual(*variables(solution)), 0.0, atol=1e-8)
        expected = solve_dense(problem, "piqp")
        best = problem.objective(expected.goal_offset, expected.multipliers, expected.terminal_multipliers)
        assert problem.objective(*variables(solution)) == pytest.approx(best, rel=1e-8, abs=1e-14)
        differences.append(np.abs(solution.goal_offset - expected.goal_offset).max())
    assert np.median(differences) < 1e-8
    assert max(differences) < 1e-5


def test_robots_that_come_and_go_change_the_rows_of_the_next_problem():
    """One estimator writes them all: only robots seen for the whole window have a problem."""
    scene = scene_of("abcd")
    estimator = InverseOptimalControl(scene)
    for company in ("abcd", "a", "ab", "abcd", "abd"):
        tracks = {robot: track for robot, track in passing(9).items() if robot in company}
        found = estimator.problems(remembered(tracks))
        assert set(found) == set(company) & set("ab")
        alone = InverseOptimalControl(scene).problems(remembered(tracks))
        np.testing.assert_array_equal(found["a"].values, alone["a"].values)
        assert found["a"].values.shape == (STEPS, FIRST_DISTANCE + len(company) - 1)


def test_goals_are_those_of_a_public_solver_on_an_independent_set_up():
    cases = [(tracks, robot) for tracks in PASSING[:6] for robot in "ab"]
    cases += [(tracks, robot) for tracks in windows_of_a_crossing() for robot in "abc"]
    dense = [dense_problem(scene_of(tracks), tracks, robot) for tracks, robot in cases]
    assert_same([solution_of(tracks, robot) for tracks, robot in cases], dense)


def test_a_solver_of_another_kind_finds_the_same_goal():
    """DAQP is a dual active-set method."""
    tracks = passing(2)
    expected = solve_dense(dense_problem(scene_of(tracks), tracks, "a"), "daqp")
    assert solution_of(tracks).goal_offset == pytest.approx(expected.goal_offset, abs=1e-4)


@pytest.mark.parametrize("tracks", [passing(0), passing(1)])
def test_the_solution_fulfils_the_optimality_conditions(tracks):
    """Karush, Kuhn, Tucker: sufficient, since the program is convex.

    With multipliers y of the stationarity equations and objective f the conditions are
    ∂f/∂z + Aᵀy = 0 for the free variables, ≥ 0 for λ, and 0 where λ > 0.
    """
    dense: DenseProblem = dense_problem(scene_of(tracks), tracks, "a")
    solution = solution_of(tracks)
    offset, multipliers, terminal = variables(solution)
    profile = np.append(solution.stationarity_multipliers, [0.0, 0.0]).reshape(-1, 2)[::-1]
    y = np.diff(profile, axis=0).ravel() / STEP_S  # from headings and speeds to inputs
    np.testing.assert_allclose(dense.residual(offset, multipliers, terminal), 0.0, atol=1e-8)
    nearness = np.array([1e-6, 1e-6, 1.0])
    np.testing.assert_allclose(2 * nearness * offset + dense.by_goal.T @ y, 0.0, atol=1e-8)
    np.testing.assert_allclose(2 * terminal + dense.terminal @ y, 0.0, atol=1e-8)
    assert multipliers.min() >= 0.0
    products = np.einsum("kn,kn->k", multipliers, dense.values)
    slope = 2 * multipliers + 2 * products[:, None] * dense.values + dense.gradients @ y
    assert slope.min() >= -1e-9
    np.testing.assert_allclose(multipliers * slope, 0.0, atol=1e-8)
    assert multipliers.max() > 1e-3, "no limit explains anything: the case shows nothing"


def test_every_size_is_solved_by_the_same_compiled_kernel():
    """One robot and many, short windows and long ones: nothing is compiled again."""
    solution_of(passing(0))
    compiled = len(solve_inverse.signatures)
    random = np.random.default_rng(11)
    for robots, steps in ((1, 2), (2, 15), (12, 15), (2, 40)):
        starts = random.uniform(-3.0, 3.0, (robots, 4)) * [1.0, 1.0, 1.0, 0.3]
        tracks = {f"{i:02}": drive(random, tuple(start), steps + 2) for i, start in enumerate(starts)}
        scene = scene_of(tracks, horizons=Horizons(estimation_steps=steps))
        found = solution_of(tracks, "00", scene)
        expected = solve_dense(dense_problem(scene, tracks, "00"), "piqp")
        assert found.solved
        assert found.goal_offset == pytest.approx(expected.goal_offset, abs=1e-5)
    assert len(solve_inverse.signatures) == compiled


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("field", ["states", "values", "bearings", "weights"])
def test_what_is_not_finite_leaves_the_problem_unsolved(field, value):
    problem = all_problems(passing(0))["a"]
    spoiled = getattr(problem, field).copy()
    spoiled[tuple(size // 2 for size in spoiled.shape)] = value
    assert not solve_inverse(problem._replace(**{field: spoiled}), ITERATIONS).solved


def test_too_few_iterations_leave_the_problem_unsolved():
    tracks = passing(0)
    problem = all_problems(tracks)["a"]
    solved = [solve_inverse(problem, iterations).solved for iterations in range(1, 30)]
    assert solved == sorted(solved)
    assert not solved[5]
    assert solved[20]


def test_standing_needs_no_multipliers_and_its_goal_is_where_the_robot_stands():
    tracks = passing(0) | {"a": np.tile([1.0, -2.0, 0.4, 0.0], (STEPS + 2, 1))}
    solution = solution_of(tracks)
    assert solution.solved
    for each in (*variables(solution), solution.stationarity_multipliers):
        assert not each.any()


def test_robots_in_the_same_place_are_no_obstacle_to_a_solution():
    """The direction away from the other is undefined; the constraint counts, its derivative does not."""
    tracks = passing(0)
    tracks["b"] = tracks["a"].copy()
    solution = solution_of(tracks)
    expected = solve_dense(dense_problem(scene_of(tracks), tracks, "a"), "piqp")
    assert solution.solved
    assert solution.goal_offset == pytest.approx(expected.goal_offset, abs=1e-6)


def test_the_iterations_allowed_are_at_least_twice_those_ever_needed():
    for tracks in [*PASSING, *windows_of_a_crossing(), *NOISY]:
        loose = scene_of(tracks, limits=LOOSE, area=square(1000.0))
        wide = InverseOptimalControl(loose).problems(remembered(tracks))
        for problem in (*all_problems(tracks).values(), *wide.values()):
            assert solve_inverse(problem, ITERATIONS // 2).solved
