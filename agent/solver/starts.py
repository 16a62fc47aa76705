"""Inputs to start a solver from, all within the limits of the vehicles."""

import numpy as np

from agent.solver.problem import JointProblem
from agent.vehicle import Array
from protocol.vehicle import Input, braking_input, reachable_inputs

SIDESTEP_RADPS = 0.2
"""Turn rate of the cold start. All robots lean to the same side, which keeps standing robots clear of one
another and lets a symmetrical crossing begin as a roundabout instead of a deadlock."""


def shifted(inputs: Array) -> Array:
    """Last step's inputs of one robot, one step on; the new last input is zero. Shape (K, 2)."""
    return np.concatenate([inputs[1:], np.zeros((1, 2))])


def cold_start(problem: JointProblem) -> Array:
    """Every robot brakes to a standstill while leaning slightly to the left. Shape (M, K, 2)."""
    leaning = braking_inputs(problem)
    leaning[:, :, 0] += SIDESTEP_RADPS
    return within_limits(problem, leaning)


def braking_inputs(problem: JointProblem) -> Array:
    """Every robot brakes as hard as its limits allow, then stands. Shape (M, K, 2)."""
    inputs = np.empty((len(problem.states), problem.steps, 2))
    for robot, limits in enumerate(problem.limits):
        previous, speed = Input(*problem.previous_inputs[robot]), float(problem.states[robot, 3])
        for k in range(problem.steps):
            previous = braking_input(limits, previous, speed, problem.step_s)
            speed += problem.step_s * previous.acceleration_mps2
            inputs[robot, k] = previous
    return inputs


def within_limits(problem: JointProblem, inputs: Array) -> Array:
    """Inputs brought inside the input and rate limits, stage by stage. Shape (M, K, 2)."""
    result = np.empty_like(inputs)
    for robot, limits in enumerate(problem.limits):
        previous = Input(*problem.previous_inputs[robot])
        for k in range(problem.steps):
            reachable = reachable_inputs(limits, previous, problem.step_s)
            previous = reachable.clip(Input(*inputs[robot, k]))
            result[robot, k] = previous
    return result
