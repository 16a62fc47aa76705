"""How robots brake, and when and where a solution is looked for a second time."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from agent_helpers import NEVER, SAFETY_M, assert_inputs_within_limits, problem_of

from agent.solve import Deadline
from agent.solve.problem import JointProblem, Solution, Start, braking_inputs
from agent.solve.starts import AWAY, cold_start, is_deadlock, solve_well
from protocol.vehicle import Limits


def test_braking_inputs_bring_each_robot_to_a_standstill_within_its_own_limits():
    limits = (Limits(), Limits(speed_mps=2.0, acceleration_mps2=1.0, jerk_mps3=3.0, turn_rate_radps=0.3))
    states, previous = [(0.0, 0.0, 0.0, 4.5), (9.0, 0.0, 0.0, -2.0)], [(0.5, 3.0), (-0.3, -1.0)]
    problem = replace(problem_of(states, np.zeros((2, 4)), previous=previous, steps=60), limits=limits)
    inputs = braking_inputs(problem)
    assert_inputs_within_limits(problem, inputs)
    np.testing.assert_allclose(problem.rollout(inputs)[:, -1, 3], 0.0, atol=1e-6)
    np.testing.assert_allclose(inputs[:, -1], 0.0, atol=1e-5)


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


def chosen(answers: Sequence[Solution], deadline: Deadline = NEVER) -> tuple[int, int]:
    """Index of the answer that is taken, and how many are asked for."""
    solver, start = Canned(answers), cold_start(PROBLEM)
    best = solve_well(solver, PROBLEM, start, lambda: start, deadline)
    return [answer is best for answer in answers].index(True), len(answers) - len(solver.left)


FAR = 0.5
"""A violation by more than a tenth of the distance."""
CHOICES: dict[str, tuple[Solution, Solution, tuple[int, int]]] = {
    "a good one is enough": (solution(100.0), solution(1.0), (0, 1)),
    "so is one that violates by little": (solution(100.0, violation_m=0.1), solution(1.0), (0, 1)),
    "solved before unsolved": (solution(100.0, solved=False), solution(900.0), (1, 2)),
    "going on before a deadlock": (solution(100.0, deadlock=True), solution(900.0), (1, 2)),
    "solved deadlock before unsolved": (solution(1.0, solved=False), solution(9.0, deadlock=True), (1, 2)),
    "kept distances before broken ones": (solution(100.0, violation_m=FAR), solution(900.0), (1, 2)),
    "the cheaper deadlock": (solution(100.0, deadlock=True), solution(90.0, deadlock=True), (1, 2)),
    "the first one if the other is worse": (solution(9.0, violation_m=FAR), solution(9e9), (0, 2)),
    "none solved": (solution(100.0, solved=False), solution(100.0, solved=False), (0, 2)),
    "no number": (solution(math.nan, solved=False), solution(100.0), (1, 2)),
}


@pytest.mark.parametrize(("first", "other", "expected"), CHOICES.values(), ids=CHOICES)
def test_where_the_first_solution_is_poor_the_better_one_of_two_is_taken(first, other, expected):
    assert chosen([first, other]) == expected


def test_after_the_deadline_a_poor_solution_is_taken():
    times = iter([0.0, 1.0, 2.0])
    deadline = Deadline(lambda: next(times), 1.5)
    deadline.begin()
    answers = [solution(100.0, deadlock=True), solution(90.0)]
    assert [chosen(answers, deadline) for _ in range(2)] == [(1, 2), (0, 1)]


def test_robots_that_stand_for_another_reason_are_not_deadlocked():
    standing = solution(1.0, deadlock=True)
    assert is_deadlock(PROBLEM, standing)
    unhindered = replace(standing, forces=np.zeros((2, 31, 2)))
    assert not is_deadlock(PROBLEM, unhindered)
    goals = standing.states[:, -1] + [AWAY * SAFETY_M / 2, 0.0, 0.0, 0.0]
    assert not is_deadlock(replace(PROBLEM, goals=goals), standing)
    creeping = standing.states.copy()
    creeping[:, -5:, 1] += 0.1
    assert not is_deadlock(PROBLEM, replace(standing, states=creeping))
