"""When a robot has arrived: the one rule that the referee and the robots share."""

import math
from collections.abc import Sequence


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
