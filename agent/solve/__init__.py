"""Trajectory problems (eq. 1 and eq. 7), what solves them, and by when."""

from collections.abc import Callable
from typing import Literal

from agent.solve.problem import JointSolver

SolverName = Literal["realtime", "reference"]
"""What ``--solver`` takes."""

ITERATIONS = 2
"""Of the real-time solver in a step, unless told otherwise."""

Clock = Callable[[], float]
"""Seconds from any fixed point; never runs backwards."""


class Deadline:
    """The end of the time that a decision may take; each decision has its own.

    All that a decision takes from the clock is at which question the time was over. So that is kept: with it
    the decision can be repeated exactly.

    Args:
        clock: never runs backwards.
        budget_s: the time in s; None for as long as it takes, which makes decisions independent of the clock.

    Attributes:
        cut_short_at: the first question of the present decision that was answered with yes, counted from 0;
            None as long as there is none.
    """

    def __init__(self, clock: Clock, budget_s: float | None) -> None:
        self._clock = clock
        self._budget_s = budget_s
        self._begin_s = 0.0
        self._questions = 0
        self.cut_short_at: int | None = None

    def begin(self) -> None:
        """A decision begins."""
        self._questions = 0
        self.cut_short_at = None
        if self._budget_s is not None:
            self._begin_s = self._clock()

    def has_passed(self) -> bool:
        """Whether the time is over; once it is, it stays so until the next decision begins."""
        if self.cut_short_at is None and self._is_over(self._questions):
            self.cut_short_at = self._questions
        self._questions += 1
        return self.cut_short_at is not None

    def _is_over(self, question: int) -> bool:
        return self._budget_s is not None and self._clock() - self._begin_s >= self._budget_s


def joint_solver(name: SolverName, iterations: int, deadline: Deadline) -> JointSolver:
    """The solver of a name; ``iterations`` and ``deadline`` bound the real-time one only.

    Each is imported when it is wanted: neither needs the memory and the start-up time of the other.
    """
    if name == "reference":
        from agent.solve.reference import ReferenceSolver

        return ReferenceSolver()
    from agent.solve.realtime.solver import RealTimeSolver

    return RealTimeSolver(iterations, deadline)
