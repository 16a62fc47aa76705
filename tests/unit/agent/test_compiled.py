"""Compiled kernels give the same bits wherever their arrays lie in memory."""

import random
import time

import numpy as np
from agent_helpers import problem_of

from agent.solve import joint_solver
from agent.solve.deadline import Deadline
from agent.solve.multistart import cold_starts

TRIES = 2000
LARGEST = 2000
"""Of the arrays in between: they share the heap with those of the kernels."""


def crossing(robots):
    """Robots on a circle that drive to the other side."""
    angles = 2.0 * np.pi * np.arange(robots) / robots + 0.1
    headings = angles + np.pi
    there = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    states = np.column_stack([4.0 * there, headings, np.full(robots, 0.6)])
    goals = np.column_stack([-4.0 * there, headings, np.zeros(robots)])
    return problem_of(states, goals)


def test_a_solution_does_not_depend_on_where_the_arrays_lie():
    """As it does where sums may be reordered: vector units are used or not by how far apart arrays are."""
    chance = random.Random(5)
    solver = joint_solver("realtime", 2, Deadline(time.perf_counter, None))
    problem = crossing(4)
    first = solver.solve(problem, cold_starts(problem)[0])
    start = first.start()
    others, found = [], set()
    for _ in range(TRIES):
        others += [np.empty(chance.randrange(1, LARGEST)) for _ in range(chance.randrange(6))]
        chance.shuffle(others)
        del others[60:]
        found.add(solver.solve(problem, start).inputs.tobytes())
    assert len(found) == 1
