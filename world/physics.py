"""How a vehicle moves in one step: the truth, independent of the model that the robots plan with."""

import math
from typing import NamedTuple

from protocol.vehicle import Input, Limits, reachable_inputs

ROUNDING = 1e-5
"""Inputs nearer than this, in rad/s or m/s², count as equal.

A robot's solver meets its limits up to a tolerance, and a speed limit that is met to 1e-7 m/s is an
acceleration to 1e-6 m/s². That is no violation.
"""


class VehicleState(NamedTuple):
    """The state (p_x, p_y, ψ, v) of eq. 8; the heading runs on through whole turns."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


class Driven(NamedTuple):
    """The outcome of one step."""

    state: VehicleState
    applied: Input
    clipped: bool
    """Whether the wanted input differed from the applied one by more than rounding."""


def drive(
    limits: Limits, state: VehicleState, previous_input: Input, wanted_input: Input, step_s: float
) -> Driven:
    """Move a vehicle by one explicit Euler step (eq. 8).

    The wanted input is first brought within the input and rate limits. At the speed limit the speed stays,
    and the applied acceleration is the one that really took place: a vehicle that is held at its top speed
    can brake at once.

    Args:
        limits: of this vehicle.
        state: at the beginning of the step.
        previous_input: applied during the step before; the rate limits start from it.
        wanted_input: turn rate in rad/s and acceleration in m/s² that were commanded.
        step_s: Δt.
    """
    turn_rate, acceleration = reachable_inputs(limits, previous_input, step_s).clip(wanted_input)
    speed = state.speed_mps + step_s * acceleration
    if abs(speed) > limits.speed_mps:
        speed = math.copysign(limits.speed_mps, speed)
        acceleration = (speed - state.speed_mps) / step_s
    moved = VehicleState(
        state.x_m + step_s * state.speed_mps * math.cos(state.heading_rad),
        state.y_m + step_s * state.speed_mps * math.sin(state.heading_rad),
        state.heading_rad + step_s * turn_rate,
        speed,
    )
    applied = Input(turn_rate, acceleration)
    clipped = any(abs(a - w) > ROUNDING for a, w in zip(applied, wanted_input, strict=True))
    return Driven(moved, applied, clipped)
