"""A differentially driven vehicle: what its limits allow at the next step, and when it has arrived.

State (p_x, p_y, ψ, v): position in m and heading in rad in the frame of the area, speed in m/s, negative when
reversing. Input (ω, a): turn rate in rad/s and acceleration in m/s², held for one step.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import Field

from chassis.files import Record

Positive = Annotated[float, Field(gt=0, le=1e3)]


class Limits(Record):
    """Symmetric limits of one vehicle (table 1 of Majer et al. 2026 gives the defaults)."""

    speed_mps: Positive = 4.5
    acceleration_mps2: Positive = 3.0
    turn_rate_radps: Positive = 1.57
    jerk_mps3: Positive = 7.0
    turn_acceleration_radps2: Positive = 0.5


class Input(NamedTuple):
    """What drives a vehicle for one step."""

    turn_rate_radps: float
    acceleration_mps2: float


STANDSTILL = Input(0.0, 0.0)


class Reachable(NamedTuple):
    """The lowest and the highest input that can follow the previous one."""

    lowest: Input
    highest: Input

    def clip(self, wanted: Input) -> Input:
        """The reachable input nearest to the wanted one."""
        return Input(*(min(max(w, low), high) for w, low, high in zip(wanted, *self, strict=True)))


def reachable_inputs(limits: Limits, previous: Input, step_s: float) -> Reachable:
    """Inputs that respect the input limits and the rate limits (eq. 9, second and third row).

    A previous input outside the limits (a disturbance) is brought back inside first, so that the result is
    never empty.
    """
    bounds = Input(limits.turn_rate_radps, limits.acceleration_mps2)
    rates = Input(limits.turn_acceleration_radps2 * step_s, limits.jerk_mps3 * step_s)
    held = Input(*(min(max(p, -b), b) for p, b in zip(previous, bounds, strict=True)))
    lowest = Input(*(max(h - r, -b) for h, r, b in zip(held, rates, bounds, strict=True)))
    highest = Input(*(min(h + r, b) for h, r, b in zip(held, rates, bounds, strict=True)))
    return Reachable(lowest, highest)


def braking_input(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The next input on the way to a standstill: as fast as the limits allow, without overshooting.

    The strongest deceleration is chosen from which the jerk limit still lets the acceleration return to zero
    by the time the vehicle stands; the turn rate goes straight to zero.
    """
    wanted = Input(0.0, settling_rate(-speed_mps / step_s, limits.jerk_mps3 * step_s))
    return reachable_inputs(limits, previous, step_s).clip(wanted)


def speed_after(limits: Limits, speed_mps: float, driven: Input, step_s: float) -> float:
    """The speed one step on: at its limit it stays."""
    return min(max(speed_mps + step_s * driven.acceleration_mps2, -limits.speed_mps), limits.speed_mps)


def settling_rate(way: float, change: float) -> float:
    """The highest rate at which a way can begin so that it ends there, at rest, without overshooting.

    Args:
        way: how far to go, as the sum of the rates of all steps.
        change: by which the rate can differ from step to step.
    """
    # Ramping out from a rate of n·change, change by change, is a way of change·n(n+1)/2.
    steps = (math.sqrt(1.0 + 8.0 * abs(way) / change) - 1.0) / 2.0
    whole = math.ceil(steps)
    size = (abs(way) + change * whole * (whole - 1) / 2.0) / whole if whole else 0.0
    return math.copysign(size, way)


def stopping_time_s(limits: Limits) -> float:
    """What braking from full speed to a standstill takes, steadily driven before: in s, without the Δt.

    The acceleration goes to its limit and back to zero, each as fast as the jerk limit lets it; it does not
    get there where the speed is gone before.
    """
    speed, acceleration, jerk = limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3
    if speed < acceleration**2 / jerk:
        return 2.0 * math.sqrt(speed / jerk)
    return speed / acceleration + acceleration / jerk


def stopping_distance_m(limits: Limits) -> float:
    """The way of ``stopping_time_s``, in m: speeds mirror each other around half the full one."""
    return limits.speed_mps * stopping_time_s(limits) / 2.0


def wrap_angle(angle_rad: float) -> float:
    """The same angle in [−π, π]."""
    return math.remainder(angle_rad, math.tau)


def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """The same angle, moved by whole turns to lie within half a turn of the reference."""
    return reference_rad + wrap_angle(angle_rad - reference_rad)


def has_arrived(state: Sequence[float], goal: Sequence[float], tolerance: float) -> bool:
    """Whether ‖x − x_F‖₂ ≤ μ over the full state.

    The publication writes the squared norm; its data show that the norm itself was compared (both published
    durations of scenario 8a are the first step at which the last robot satisfies it).

    Args:
        state: p_x, p_y in m, heading in rad, speed in m/s.
        goal: the same four of the goal; the goal speed is zero.
        tolerance: μ, over metres, radians and metres per second alike.
    """
    errors = (
        state[0] - goal[0],
        state[1] - goal[1],
        wrap_angle(state[2] - goal[2]),
        state[3] - goal[3],
    )
    return math.hypot(*errors) <= tolerance
