"""Trajectory problems (eq. 1 and eq. 7) and what solves them."""

from typing import Literal

from agent.solve.deadline import Deadline
from agent.solve.problem import JointSolver

SolverName = Literal["realtime", "reference"]
"""What ``--solver`` takes."""

ITERATIONS = 2
"""Of the real-time solver in a step, unless told otherwise."""


def joint_solver(name: SolverName, iterations: int, deadline: Deadline) -> JointSolver:
    """The solver of a name; ``iterations`` and ``deadline`` bound the real-time one only.

    Each is imported when it is wanted: neither needs the memory and the start-up time of the other.
    """
    if name == "reference":
        from agent.solve.reference import ReferenceSolver

        return ReferenceSolver()
    from agent.solve.realtime.solver import RealTimeSolver

    return RealTimeSolver(iterations, deadline)
