"""Which of several local optima is taken: canned solutions for the rule, real ones for deadlocks."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from agent_helpers import NEVER, SOLVERS, cold, problem_of

from agent.solve.deadline import Deadline
from agent.solve.multistart import NEAR_GOAL_M, best_solution, cold_starts, escapes, is_deadlock
from agent.solve.problem import JointProblem, Solution, Start

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


def head_on() -> JointProblem:
    return problem_of(
        [(-3.0, 0.0, 0.0, 0.0), (3.0, 0.0, math.pi, 0.0)], [(3.0, 0.0, 0.0, 0.0), (-3.0, 0.0, math.pi, 0.0)]
    )


def test_robots_that_stop_face_to_face_are_deadlocked_and_robots_that_pass_are_not():
    problem = head_on()
    leaning, _, _, straight = (SOLVERS["realtime"].solve(problem, start) for start in cold_starts(problem))
    assert straight.solved
    assert straight.states[0, -1, 0] < 0.0 < straight.states[1, -1, 0]
    assert is_deadlock(problem, straight)
    assert not is_deadlock(problem, leaning)


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
def test_a_deadlocked_start_is_rejected(solver):
    problem = head_on()
    straight, leaning = cold_starts(problem)[3], cold_starts(problem)[0]
    best = best_solution(solver, problem, [straight, leaning], NEVER)
    assert best.states[0, -1, 0] > best.states[1, -1, 0]


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
        ((3.6, -0.85, 2.27, 0.0), (-0.04, 0.21, 2.06, 0.0), (2.98, 0.39)),
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
