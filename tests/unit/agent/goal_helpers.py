"""Drives of robots whose goals are known, and how near to those an estimator comes."""

import numpy as np
from agent_helpers import SOLVERS, STEP_S
from realtime_helpers import closed_loop, random_crossing

from agent.estimate.goals import GoalEstimator
from agent.remember.memory import Memory
from agent.solve.problem import JointProblem, JointSolver
from agent.solve.vehicle import Array


def followed(robots: int, seed: int, steps: int) -> tuple[Array, Array]:
    """States (steps, N, 4) of robots that know each other's goals, and those goals (N, 2)."""
    return drive(random_crossing(robots, seed), steps)


def drive(
    problem: JointProblem, steps: int, solver: JointSolver = SOLVERS["realtime"]
) -> tuple[Array, Array]:
    """The same from any problem on."""
    loop = list(closed_loop(problem, steps, solver))
    return np.array([each.problem.states for each in loop]), problem.goals[:, :2]


def errors_m(estimator: GoalEstimator, states: Array, goals: Array) -> Array:
    """Distance of each robot's estimate from its goal after every step, shape (steps, N)."""
    memory, names = Memory(17, STEP_S), [str(robot) for robot in range(len(goals))]
    found = []
    for step, now in enumerate(states):
        memory.remember(step, dict(zip(names, map(tuple, now.tolist()), strict=True)))
        estimates = estimator.estimate(memory)
        found.append(
            [np.linalg.norm(estimates[name][:2] - goal) for name, goal in zip(names, goals, strict=True)]
        )
    return np.array(found)
