"""How near robots come to one another, and whether the two of a pair agree on which side they will pass."""

import math
from array import array
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from chassis.files import Record
from protocol.messages import Mind, Truth
from protocol.scene import Scene

LATE_STEPS = 5
"""Minds of one step arrive within this many further steps."""
NEAR = 2.0
"""Pairs that nobody predicts to come nearer than this many safety distances need no side."""

Path = NDArray[np.complex128]
"""Positions x + iy in m for the present and every step of the horizon, shape (K_P + 1,)."""


class DistanceQuantiles(Record):
    """Of smallest distances of two robots, relative to what they should be: over steps, or over runs."""

    min: float
    p1: float
    p10: float
    p50: float

    @classmethod
    def of(cls, values: Sequence[float] | NDArray[np.float64]) -> Self:
        """The quantiles of values, of which there is one at least."""
        least, p1, p10, p50 = np.percentile(values, [0.0, 1.0, 10.0, 50.0]).tolist()
        return cls(min=least, p1=p1, p10=p10, p50=p50)


class RelativeDistances(Record):
    """Distances of centres, relative to two distances of the same pair."""

    to_collision: DistanceQuantiles
    """Less than 1: bodies overlap."""
    to_safety: DistanceQuantiles
    """Less than 1: nearer than robots plan to come."""


class _Predicted(NamedTuple):
    """Of a mind: what is compared with others."""

    robot: str
    arrived: bool
    paths: dict[str, Path]

    def relative(self, one: str, other: str) -> Path | None:
        """The way of one robot as another sees it; None where this mind lacks a prediction of either."""
        if one not in self.paths or other not in self.paths:
            return None
        steps = min(len(self.paths[one]), len(self.paths[other]))
        return self.paths[other][:steps] - self.paths[one][:steps] if steps else None


class Encounters:
    """Gathers what comes of pairs of robots in a run, from its messages in the order of its steps.

    Without a scene, which says how large robots are, nothing is gathered.
    """

    def __init__(self) -> None:
        self._collision_m: dict[tuple[str, str], float] = {}
        self._safety_m: dict[tuple[str, str], float] = {}
        self.begin()

    def begin(self) -> None:
        """A new epoch of the world begins."""
        self._to_collision, self._to_safety = array("d"), array("d")
        self._minds: dict[int, dict[str, _Predicted]] = {}
        self.pair_steps = 0
        """Pairs of robots with predictions of both that are to pass near each other, added up over steps."""
        self._disagreements = 0

    def meet(self, scene: Scene) -> None:
        """Take in how large robots are."""
        pairs = list(combinations(sorted(scene.robots), 2))
        self._collision_m = {pair: scene.collision_distance_m(*pair) for pair in pairs}
        self._safety_m = {pair: scene.safety_distance_m(*pair) for pair in pairs}

    def measure(self, truth: Truth) -> None:
        """Take in where robots are at a step."""
        to_collision = to_safety = math.inf
        for pair in combinations(sorted(truth.robots), 2):
            if pair not in self._collision_m:
                continue
            one, other = (truth.robots[robot].state for robot in pair)
            distance_m = math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)
            to_collision = min(to_collision, distance_m / self._collision_m[pair])
            to_safety = min(to_safety, distance_m / self._safety_m[pair])
        if to_safety < math.inf:
            self._to_collision.append(to_collision)
            self._to_safety.append(to_safety)

    def compare(self, mind: Mind) -> None:
        """Take in what a robot predicts, and compare it with the others' predictions at the same step."""
        if not self._safety_m or not mind.prediction:
            return
        paths = {
            robot: np.array(path, dtype=np.float64).reshape(-1, 2).view(np.complex128)[:, 0]
            for robot, path in mind.prediction.items()
        }
        new = _Predicted(mind.robot, mind.arrived, paths)
        for old in [step for step in self._minds if step < mind.step - LATE_STEPS]:
            del self._minds[old]
        others = self._minds.setdefault(mind.step, {})
        for other in others.values():
            self._count(new, other)
        others[mind.robot] = new

    def _count(self, one: _Predicted, other: _Predicted) -> None:
        pair = (min(one.robot, other.robot), max(one.robot, other.robot))
        if pair not in self._safety_m or (one.arrived and other.arrived):
            return
        paths = [path for mind in (one, other) if (path := mind.relative(*pair)) is not None]
        if len(paths) < 2:
            return
        if min(float(np.abs(path).min()) for path in paths) < NEAR * self._safety_m[pair]:
            self.pair_steps += 1
            self._disagreements += winding_rad(paths[0]) * winding_rad(paths[1]) < 0.0

    @property
    def side_disagreement(self) -> float | None:
        """Share of ``pair_steps`` in which the two predict to pass on different sides; None without any."""
        return self._disagreements / self.pair_steps if self.pair_steps else None

    @property
    def relative_distances(self) -> RelativeDistances | None:
        """None where no two robots were in the scene."""
        if not self._to_collision:
            return None
        return RelativeDistances(
            to_collision=DistanceQuantiles.of(self._to_collision),
            to_safety=DistanceQuantiles.of(self._to_safety),
        )


def pooled(shares: Iterable[tuple[float | None, int]]) -> float | None:
    """The share in all of several runs: of each its share, None for none, and of how many."""
    known = [(share, count) for share, count in shares if share is not None]
    total = sum(count for _, count in known)
    return sum(share * count for share, count in known) / total if total else None


def winding_rad(path: Path) -> float:
    """By how much the line of sight to something turns that drives along a path, counter-clockwise, in rad.

    Its sign is the side on which the two pass: positive, each has the other on its left.
    """
    return float(np.angle(path[1:] * path[:-1].conj()).sum())
