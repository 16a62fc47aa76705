"""The quadratic program of eq. 6: its optimality conditions, and an independent set-up and solver."""

import numpy as np
import pytest
from agent_helpers import STEP_S, euler, remembered, scene_of
from inverse_oracle import solve_inverse

from agent.estimation.inverse_optimal_control import (
    NEARNESS,
    InverseOptimalControl,
    InversePrograms,
    inverse_problem,
)
from protocol.scene import Horizons

STEPS = 15


def drive(random: np.random.Generator, start: tuple[float, ...], states: int) -> np.ndarray:
    """A smooth drive within all limits, with some of them met."""
    changes = random.uniform(-1.0, 1.0, (states - 1, 2)).clip(-0.8, 0.8) / 0.8 * [0.05, 0.7]
    return euler(start, np.cumsum(changes, axis=0).clip([-1.57, -3.0], [1.57, 3.0]))


def scenes(seed: int) -> dict[str, np.ndarray]:
    """Robots that pass one another closely; c came late, d only just."""
    random = np.random.default_rng(seed)
    tracks = {
        "a": drive(random, (-3.0, 0.0, 0.2, 1.0), STEPS + 2),
        "b": drive(random, (-1.0, -2.0, 1.5, 1.0), STEPS + 2),
        "c": drive(random, (2.0, 1.0, 3.0, 0.5), STEPS + 2),
        "d": drive(random, (-3.0, -2.0, 0.5, 2.0), STEPS + 2),
    }
    return tracks | {"c": tracks["c"][-9:], "d": tracks["d"][-1:]}


@pytest.mark.parametrize("seed", range(4))
def test_the_solution_fulfils_the_optimality_conditions_of_the_program(seed):
    """Karush, Kuhn, Tucker: sufficient, since the program is convex.

    With multipliers y of the stationarity equations and objective f the conditions are
    ∂f/∂z + Aᵀy = 0 for the free variables, ≥ 0 for λ, and 0 where λ > 0.
    """
    problem = inverse_problem(scene_of("abcd"), remembered(scenes(seed)), "a")
    solution = InversePrograms().solve(problem)
    assert solution.solved
    assert problem.values.shape == (STEPS, 4 + 2 + 8 + 3)
    residual = (
        problem.goal_gradient @ solution.goal_offset
        + np.einsum("knu,kn->u", problem.gradients, solution.multipliers)
        + problem.terminal.T @ solution.terminal_multipliers
        + problem.cost_gradient
    )
    np.testing.assert_allclose(residual, 0.0, atol=1e-6)
    assert solution.multipliers.min() >= -1e-9
    y = solution.stationarity_multipliers
    np.testing.assert_allclose(
        2 * NEARNESS * solution.goal_offset + problem.goal_gradient.T @ y, 0.0, atol=1e-6
    )
    np.testing.assert_allclose(2 * solution.terminal_multipliers + problem.terminal @ y, 0.0, atol=1e-6)
    products = np.einsum("kn,kn->k", solution.multipliers, problem.values)
    slope = 2 * solution.multipliers + 2 * products[:, None] * problem.values + problem.gradients @ y
    assert slope.min() >= -1e-6
    np.testing.assert_allclose(solution.multipliers * slope, 0.0, atol=1e-6)
    assert solution.multipliers.max() > 1e-3, "no limit explains anything: the case shows nothing"


@pytest.mark.parametrize("seed", range(4))
def test_an_independent_set_up_and_solver_find_the_same_goal(seed):
    """The input before the window is known here, and robots seen later have fewer distances."""
    scene, tracks = scene_of("abcd"), scenes(seed)
    before = (tracks["a"][1] - tracks["a"][0])[2:] / STEP_S
    others = {robot: track[-STEPS - 1 :] for robot, track in tracks.items() if robot != "a"}
    oracle = solve_inverse(scene, "a", tracks["a"][1:], before, others)
    memory = remembered(tracks)
    problem = inverse_problem(scene, memory, "a")
    solution = InversePrograms().solve(problem)
    assert tracks["a"][-1, :3] + solution.goal_offset == pytest.approx(oracle.goal, abs=1e-4)
    assert solution.terminal_multipliers == pytest.approx(oracle.terminal_multipliers, abs=1e-5)
    objective = (
        (NEARNESS * solution.goal_offset**2).sum()
        + (solution.multipliers**2).sum()
        + (solution.terminal_multipliers**2).sum()
        + (np.einsum("kn,kn->k", solution.multipliers, problem.values) ** 2).sum()
    )
    assert objective == pytest.approx(oracle.objective, rel=1e-5)
    estimate = InverseOptimalControl(scene).estimate(memory)["a"]
    assert estimate == pytest.approx([*oracle.goal.clip(-10, 10)[:2], oracle.goal[2], 0.0], abs=1e-4)


def test_without_a_state_before_the_window_the_robot_is_taken_to_have_stood():
    scene = scene_of("ab")
    tracks = {robot: track[1:] for robot, track in scenes(5).items() if robot in "ab"}
    oracle = solve_inverse(scene, "a", tracks["a"], np.zeros(2), {"b": tracks["b"]})
    solution = InversePrograms().solve(inverse_problem(scene, remembered(tracks), "a"))
    assert tracks["a"][-1, :3] + solution.goal_offset == pytest.approx(oracle.goal, abs=1e-4)


def test_every_size_of_window_and_number_of_robots_has_its_own_program():
    """One object solves them all, and what it solved before changes nothing."""
    programs = InversePrograms()
    for steps, robots in ((15, "ab"), (6, "abcd"), (15, "abcd"), (15, "ab")):
        scene = scene_of(robots, horizons=Horizons(estimation_steps=steps))
        tracks = {robot: track for robot, track in scenes(6).items() if robot in robots}
        problem = inverse_problem(scene, remembered(tracks, estimation_steps=steps), "a")
        alone, shared = InversePrograms().solve(problem), programs.solve(problem)
        assert alone.solved
        assert shared.solved
        np.testing.assert_array_equal(shared.goal_offset, alone.goal_offset)
        np.testing.assert_array_equal(shared.multipliers, alone.multipliers)


def test_a_robot_seen_later_counts_only_where_it_was_seen():
    problem = inverse_problem(scene_of("abcd"), remembered(scenes(7)), "a")
    distances = problem.gradients[:, -3:]
    unseen = {"b": 0, "c": STEPS + 1 - 9, "d": STEPS}
    for column, stages in enumerate(unseen.values()):
        assert not distances[:stages, column].any()
        assert not problem.values[:stages, 14 + column].any()
        # The positions of the first two stages do not depend on the inputs of the window.
        assert distances[max(stages, 2) :, column].any(axis=1).all()
        assert problem.values[stages:, 14 + column].all()
