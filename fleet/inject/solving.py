"""What faults do to the solving of a robot's trajectory problems."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from agent.solve.deadline import Clock, Deadline
from agent.solve.problem import JointProblem, JointSolver, Solution, Start
from protocol.faults import Infeasible, NoTime, SolverFailure

Struck = Callable[[type[Any]], bool]
"""Tells whether a fault of a kind strikes a robot at the step on which it decides."""


class StruckSolver:
    """A solver whose problems cannot be solved well, or are said not to be solved, while a fault strikes.

    Args:
        solver: the robot's own.
        struck: asked at every problem.
    """

    def __init__(self, solver: JointSolver, struck: Struck) -> None:
        self._solver = solver
        self._struck = struck

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """See :class:`agent.solve.problem.JointSolver`."""
        given = obstructed(problem) if self._struck(Infeasible) else problem
        solution = self._solver.solve(given, start)
        return replace(solution, solved=False) if self._struck(SolverFailure) else solution


class StruckDeadline(Deadline):
    """One that has passed at once while a fault strikes.

    Args:
        clock: as of a deadline.
        budget_s: the same.
        struck: asked at every question.
    """

    def __init__(self, clock: Clock, budget_s: float | None, struck: Struck) -> None:
        super().__init__(clock, budget_s)
        self._struck = struck

    def _is_over(self, question: int) -> bool:
        return self._struck(NoTime) or super()._is_over(question)


def obstructed(problem: JointProblem) -> JointProblem:
    """The same problem with an obstacle that stands where its first robot is, as large as that robot."""
    there = np.broadcast_to(problem.states[0, :2], (1, problem.steps + 1, 2))
    return replace(
        problem,
        obstacles=np.concatenate([problem.obstacles, there]),
        safety_distances=np.column_stack([problem.safety_distances, problem.safety_distances[:, 0]]),
    )
