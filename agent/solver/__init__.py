"""Trajectory problems (eq. 1 and eq. 7) and what solves them."""

from collections.abc import Callable
from typing import Literal

from agent.solver.problem import JointSolver
from agent.solver.reference import ReferenceSolver

SolverName = Literal["reference"]

SOLVERS: dict[SolverName, Callable[[], JointSolver]] = {"reference": ReferenceSolver}
"""By the name that ``--solver`` takes."""
