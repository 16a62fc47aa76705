"""On which side robots pass one another: the same for everybody who sees the same, decided anew each time."""

import math
from dataclasses import replace

import numpy as np
import pytest
from agent_helpers import NEVER, SAFETY_M, SOLVERS, STEP_S, cold, problem_of, scene_of
from hypothesis import assume, given
from hypothesis import strategies as st

from agent.remember.memory import Memory
from agent.solve.prediction import Predictor
from agent.solve.sides import CONVENTION, agreed_sides
from agent.solve.starts import cold_start
from agent.solve.vehicle import Array

SCENE = scene_of("ab")
SIGMA_M = 0.03
DOUBT_M = 0.4 + 3.0 * math.hypot(SIGMA_M, SIGMA_M)
"""Twice the margin, and three standard deviations of both positions."""
SOLVER = SOLVERS["realtime"]
bearings = st.floats(-math.pi, math.pi)


def ways(miss_m: float, bearing: float, speeds: tuple[float, float], steps: int = 30) -> dict[str, Array]:
    """Of robots that meet halfway: seen from a, b moves along the bearing, with a on its left if positive."""
    times = STEP_S * (np.arange(steps + 1) - steps // 2)
    motion = np.exp(1j * bearing)
    a = 2.0 + 1.0j - speeds[0] * motion * times
    b = 2.0 + 1.0j + speeds[1] * motion * times - 1j * miss_m * motion
    return {name: np.stack([each.real, each.imag], axis=1) for name, each in (("a", a), ("b", b))}


def side(of: dict[str, Array], sigma_m: float = SIGMA_M) -> float:
    """Of a and b; everybody finds the same for both, in whatever order it looks at them."""
    found = agreed_sides(SCENE, of, lambda _: sigma_m)
    assert found == agreed_sides(SCENE, dict(reversed(of.items())), lambda _: sigma_m)
    assert found in ({}, dict.fromkeys([("a", "b"), ("b", "a")], found.get(("a", "b"))))
    return found.get(("a", "b"), 0.0)


@given(st.floats(-4.0, 4.0), bearings, st.tuples(st.floats(0.5, 3.0), st.floats(0.5, 3.0)))
def test_who_would_come_too_close_passes_as_the_miss_says_or_else_by_the_convention(miss_m, bearing, speeds):
    """However the scene is turned, and whoever has which part in it."""
    size_m = abs(miss_m)
    assume(min(abs(size_m - DOUBT_M), abs(size_m - SAFETY_M - DOUBT_M)) > 1e-6)
    expected = 0.0
    if size_m < SAFETY_M + DOUBT_M:
        expected = CONVENTION if size_m < DOUBT_M else math.copysign(1.0, miss_m)
    seen = ways(miss_m, bearing, speeds)
    assert side(seen) == expected
    assert side({"a": seen["b"], "b": seen["a"]}) == expected
    mirrored = {robot: way * [1.0, -1.0] for robot, way in seen.items()}
    assert side(mirrored) == (expected if size_m < DOUBT_M else -expected)
    assert side(seen, sigma_m=1.0) == CONVENTION, "all of this is in doubt"


@pytest.mark.parametrize(("end", "is_open"), [(14, True), (17, False)])
def test_who_still_comes_nearer_at_the_horizon_or_is_beside_the_other_for_ever_is_not_agreed_on(end, is_open):
    seen = {robot: way[: end + 1] for robot, way in ways(0.0, 1.0, (1.0, 1.0)).items()}
    assert (side(seen) == 0.0) == is_open
    beside = {"a": seen["a"], "b": seen["a"] + [0.5, 0.5]}
    assert side(beside) == 0.0


def turned(states: Array) -> float:
    """By how much the way from the first robot to the second one turns, in rad."""
    way = states[1, :, :2] - states[0, :, :2]
    return float(np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0]))).sum())


@pytest.mark.parametrize(
    ("offset_m", "expected"), [(0.0, -1.0), (0.3, -1.0), (-0.3, -1.0), (0.6, 1.0), (-0.6, -1.0)]
)
def test_head_on_both_minds_predict_that_they_pass_on_the_agreed_side(offset_m, expected):
    """Where they would meet, both evade to their left; also where they believe in other goals."""
    seen = {"a": (-4.0, 0.0, 0.0, 1.0), "b": (4.0, offset_m, math.pi, 1.0)}
    memory = Memory(17, STEP_S)
    memory.remember(3, seen, sigmas=4 * [1e-4])  # who sees exactly needs no sides
    for far_m in (4.0, 3.2):
        goals = {"a": np.array([far_m, 0.0, 0.0, 0.0]), "b": np.array([-far_m, offset_m, math.pi, 0.0])}
        prediction = Predictor(SCENE, SOLVER, NEVER).predict(memory, goals, ())
        assert prediction.solved
        assert prediction.sides == {("a", "b"): expected, ("b", "a"): expected}
        assert turned(np.array([prediction.states[robot] for robot in "ab"])) * expected > 2.0
        apart_m = np.linalg.norm(prediction.paths["a"] - prediction.paths["b"], axis=1).min()
        assert apart_m > SAFETY_M - 1e-3


@pytest.mark.parametrize("agreed", [-1.0, 1.0])
def test_a_solution_ends_on_the_agreed_side_also_if_it_begins_on_the_other_one(agreed):
    states = [(-4.0, 0.0, 0.0, 1.0), (4.0, 0.1, math.pi, 1.0)]
    problem = problem_of(states, [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)])
    sides = agreed * (np.ones((2, 2)) - np.eye(2))
    problem, other = (replace(problem, sides=each) for each in (sides, -sides))
    wrong = SOLVER.solve(other, cold(other, 0.0))
    for begin in (cold(problem, 0.0), cold_start(problem, wrong.inputs)):
        found = SOLVER.solve(problem, begin)
        assert found.solved
        assert found.violation_m < 1e-3
        assert turned(found.states) * agreed > 2.0
    assert problem.violation_m(wrong.states) > SAFETY_M
