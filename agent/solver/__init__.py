"""Trajectory problems (eq. 1 and eq. 7) and what solves them."""

from collections.abc import Callable

from agent.solver.problem import JointSolver
from agent.solver.reference import ReferenceSolver

SOLVERS: dict[str, Callable[[], JointSolver]] = {"reference": ReferenceSolver}
"""By the name that ``--solver`` takes."""
