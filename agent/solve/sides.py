"""On which side robots pass one another: agreed without a word, from what all of them can see.

Everybody drives everybody alone in thought. Where two would then come too close, the sign of their miss says
the side: the way from the one to the other turns as it would anyway. Where they would nearly meet, so that
the sign is a matter of noise, all pairs turn clockwise: everybody evades to the left, as in a roundabout.

Nothing is remembered. Who takes the wrong side at first sees the miss shrink until the convention holds.
"""

import math
from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np

from agent.solve.vehicle import Array
from protocol.scene import Scene

CONVENTION = -1.0
"""Clockwise."""
SIGMAS = 3.0
"""Noise of so many standard deviations is reckoned with."""

Sides = Mapping[tuple[str, str], float]
"""Of pairs, in both orders: 1.0 where the way from the one to the other turns anticlockwise, else −1.0."""


def agreed_sides(scene: Scene, ways: Mapping[str, Array], sigma_m: Callable[[str], float]) -> Sides:
    """The sides of all pairs that would come too close.

    A miss within the noise of both, or within the margin that is kept beyond their bodies, tells no side:
    what it would cost to change the side is not worth an argument.

    Args:
        scene: the distances to keep.
        ways: positions (K + 1, 2) of each robot if it were alone.
        sigma_m: standard deviation of where a robot is seen.
    """
    sides = {}
    for one, other in combinations(ways, 2):
        safety_m, margin_m = scene.safety_distance_m(one, other), 2.0 * scene.safety_margin_m
        doubt_m = margin_m + SIGMAS * math.hypot(sigma_m(one), sigma_m(other))
        side = side_of(ways[other] - ways[one], safety_m, doubt_m)
        if side:
            sides[one, other] = sides[other, one] = side
    return sides


def side_of(way: Array, safety_distance_m: float, doubt_m: float) -> float:
    """The side of one pair; 0.0 where it is open.

    Args:
        way: from the one to the other, shape (K + 1, 2).
        safety_distance_m: with how much more than this they do not come too close is told by the doubt.
        doubt_m: a miss of no more tells no side.
    """
    lengths = np.linalg.norm(way, axis=1)
    nearest = 1 + int(np.argmin(lengths[1:]))
    if lengths[nearest] > safety_distance_m + doubt_m or nearest + 1 == len(way):
        return 0.0
    motion = way[nearest + 1] - way[nearest - 1]
    size = float(np.hypot(*motion))
    if size == 0.0:
        return 0.0
    miss_m = float(way[nearest, 0] * motion[1] - way[nearest, 1] * motion[0]) / size
    return CONVENTION if abs(miss_m) <= doubt_m else math.copysign(1.0, miss_m)
