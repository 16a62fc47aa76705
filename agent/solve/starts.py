"""Inputs to start a solver from, all within the limits of the vehicles."""

from collections.abc import Sequence

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import LIMITED_QUANTITIES, JointProblem, Start
from agent.solve.vehicle import Array
from protocol.vehicle import Input, braking_input

SIDESTEP_RADPS = 0.2
"""Turn rate of a cold start. When all robots lean to the same side, standing robots stay clear of one
another, and a symmetrical crossing begins as a roundabout instead of a deadlock."""


def shifted(stages: Array, steps: int = 1) -> Array:
    """Inputs, forces or pressures of one robot so many steps on; those of the new last stages are zero."""
    return np.concatenate([stages[steps:], np.zeros_like(stages[:steps])])


def cold_starts(problem: JointProblem) -> list[Start]:
    """Starts for when nothing is known yet, in order of preference.

    Every robot brakes to a standstill while leaning to its left; to its right; in turn to its left and right;
    not at all.
    """
    left = np.ones(len(problem.states))
    alternating = np.where(np.arange(len(left)) % 2, -left, left)
    return _turning(problem, [SIDESTEP_RADPS * sides for sides in (left, -left, alternating, 0.0 * left)])


def escapes(problem: JointProblem) -> list[Start]:
    """Starts for when the way ahead is blocked: all brake and turn as quickly as they can, to either side.

    Standing still is a stationary point: a heading matters only to a robot that drives.
    """
    quickest = problem.input_bounds[:, 0]
    return _turning(problem, [quickest, -quickest])


def _turning(problem: JointProblem, turns_radps: Sequence[Array]) -> list[Start]:
    """All brake, each start with other turn rates (M,) in addition."""
    braking = braking_inputs(problem)
    robots, steps = braking.shape[:2]
    starts = []
    for rates_radps in turns_radps:
        inputs = braking.copy()
        inputs[:, :, 0] += rates_radps[:, None]
        forces, pressures = np.zeros((robots, steps + 1, 2)), np.zeros((robots, steps, LIMITED_QUANTITIES))
        starts.append(Start(within_limits(problem, inputs), forces, pressures, warm=False))
    return starts


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
    bounds = problem.input_bounds
    return clip_stages(
        np.ascontiguousarray(inputs, dtype=float),
        np.clip(problem.previous_inputs, -bounds, bounds),
        bounds,
        problem.rate_bounds,
    )


@kernel
def clip_stages(inputs: Array, previous: Array, bounds: Array, rates: Array) -> Array:
    """As ``protocol.vehicle.reachable_inputs`` clips one stage, for all robots and stages."""
    result = np.empty_like(inputs)
    for robot in range(inputs.shape[0]):
        for c in range(2):
            held = previous[robot, c]
            for k in range(inputs.shape[1]):
                low = max(held - rates[robot, c], -bounds[robot, c])
                high = min(held + rates[robot, c], bounds[robot, c])
                wanted = inputs[robot, k, c]
                held = min(wanted, high) if wanted >= low else low  # what is no number becomes the lowest
                result[robot, k, c] = held
    return result
