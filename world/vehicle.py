"""How a vehicle moves in one step, with a command and without one.

This is the truth, independent of the model that the robots plan with.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from protocol.messages import Command
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input, reachable_inputs

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


@dataclass
class Vehicle:
    """A vehicle as the world moves it, step by step.

    At a step without a command it brakes: what it drives then follows from its state and the input that led
    there, and from nothing that was said before. A command beyond the limits is clipped and counted.

    Attributes:
        limits: of its inputs.
        step_s: Δt in s.
        state: at the present step.
        applied: the input that led there.
        deadline_misses: steps without a command so far.
        clipped_commands: commands so far that were beyond the limits.
    """

    limits: Limits
    step_s: float
    state: VehicleState
    applied: Input = STANDSTILL
    deadline_misses: int = 0
    clipped_commands: int = 0

    def driven_by(self, command: Command | None) -> Driven:
        """What the present step comes to with this command, or without one; nothing changes."""
        if command is not None:
            wanted = command.input
        else:
            wanted = braking_input(self.limits, self.applied, self.state.speed_mps, self.step_s)
        return drive(self.limits, self.state, self.applied, wanted, self.step_s)

    def obey(self, command: Command | None) -> None:
        """Drive to the next step, with its command; None: there is none that counts."""
        self.state, self.applied, clipped = self.driven_by(command)
        if command is None:
            self.deadline_misses += 1
        else:
            self.clipped_commands += clipped

    def stand(self) -> None:
        """Be at rest where it is; what it was to drive is forgotten."""
        self.state = self.state._replace(speed_mps=0.0)
        self.applied = STANDSTILL
