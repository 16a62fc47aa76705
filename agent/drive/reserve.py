"""The reserve: a robot does only what leaves every obeying pair able to brake clear of each other.

A robot's *contingency* is how it brakes from its present state after its last input. Everybody can compute
everybody's from what is seen. Where the contingencies of a pair are apart, a line between them at every stage
parts what each may use, and a command is allowed if the contingency after it keeps to the own side of all
lines. Braking does, so there always is one; and if both keep to their sides, their contingencies are apart at
the next step too. The proof, with what it assumes, stands in ``docs/safety.md``.

The lines leave each robot room to go on as it does, where both can: they part not only the contingencies but
also those after one more step with the last input. Of a robot that was not seen for some steps nobody knows
when it began to brake; lines then lie on this side of all that it may do.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.remember.memory import Memory
from agent.solve.compiled import kernel
from agent.solve.vehicle import Array, Booleans
from protocol.messages import Accuracy
from protocol.scene import Scene
from protocol.vehicle import Input, Limits, Reachable, braking_input, reachable_inputs
from protocol.vehicle import settling_rate as _settling_rate

CHOICES = 9
"""Values of each input that are looked at between the lowest and the highest reachable one."""
HALVINGS = 6
"""With which the part of a step is found that both of a pair may go on."""
SIGMAS = 3.0
"""Noise of so many standard deviations is reckoned with."""
CERTAIN = 0.25
"""Part of the safety margin that is kept where both robots are seen exactly; otherwise all of it is."""
EXCUSED = 0.5
"""Part of the safety margin by which a robot may cross a line before it is doubted."""
STANDS_M = 1e-9
"""Who moves by no more in a step stands: what rounding leaves of a speed."""

settling_rate = kernel(_settling_rate)


class Lines(NamedTuple):
    """What parts this robot from another one: normal · p ≥ own here, and normal · p ≤ other there."""

    normal: Array
    """Unit vectors towards this robot, shape (T + 1, 2)."""
    own: Array
    """In m, shape (T + 1,)."""
    other: Array
    """In m, shape (T + 1,)."""


class Reserve:
    """Keeps one robot to its side of all lines, and watches whether the others keep to theirs."""

    def __init__(self, scene: Scene, robot: str) -> None:
        self._scene = scene
        self._robot = robot
        self._limits = scene.robot(robot).limits
        self._steps = max(braking_steps(each.limits, scene.step_s) for each in scene.robots.values())
        self._lines: dict[str, Lines] = {}
        self._drawn = -1
        self._crossed: dict[str, int] = {}

    def update(self, memory: Memory, previous: Input, accuracy: Accuracy) -> None:
        """Draw the lines of this step, and see who has crossed those of the last one; once a step.

        Args:
            memory: the present.
            previous: what this robot drove at the step before.
            accuracy: of what is seen.
        """
        own = self._stretch(memory, self._robot, previous)
        lines: dict[str, Lines] = {}
        for other in memory.robots:
            if other == self._robot:
                continue
            there = self._stretch(memory, other, memory.previous_input(other))
            if self._has_crossed(memory, other, there[0], accuracy):
                self._crossed[other] = memory.step
            certain = memory.is_certain(self._robot) and memory.is_certain(other)
            margin_m = (CERTAIN if certain else 1.0) * self._scene.safety_margin_m
            least_m = self._scene.collision_distance_m(self._robot, other) + margin_m
            seen = memory.unseen_steps(other) == 0
            lines[other] = parted(*own, *there, least_m + self._beside_m(memory, other, there), seen)
        self._lines, self._drawn = lines, memory.step

    def doubted(self, memory: Memory) -> list[str]:
        """The robots that have crossed a line lately: since then they could not have come to a stand."""
        return [
            robot
            for robot in memory.robots
            if memory.step - self._crossed.get(robot, -self._steps - 1) <= self._steps
        ]

    def nearest_allowed(self, memory: Memory, wanted: Input, previous: Input) -> Input:
        """The wanted input, or else the allowed one that is nearest to it; after the previous input."""
        if self._are_allowed(memory, np.array([wanted])).all():
            return wanted
        choices = self._choices(previous)
        inputs = _combined(np.concatenate([choices, [wanted]]))
        allowed = inputs[self._are_allowed(memory, inputs)]
        if not len(allowed):
            return self._brake(memory, previous)
        return Input(*allowed[np.argmin(self._away(allowed, wanted, choices))].tolist())

    def room(self, memory: Memory, wanted: Input, previous: Input) -> Reachable | None:
        """Where a wanted input is not allowed, a range of turn rates and accelerations that are; else None.

        Of the ``CHOICES``, the largest rectangle of allowed ones that holds the one nearest to what is
        wanted; braking alone if none of them is allowed.
        """
        if self._are_allowed(memory, np.array([wanted])).all():
            return None
        choices = self._choices(previous)
        inputs = _combined(choices)
        allowed = self._are_allowed(memory, inputs)
        if not allowed.any():
            braking = self._brake(memory, previous)
            return Reachable(braking, braking)
        nearest = int(np.argmin(np.where(allowed, self._away(inputs, wanted, choices), np.inf)))
        rows, columns = largest_rectangle(allowed.reshape(CHOICES, CHOICES), *divmod(nearest, CHOICES))
        lowest, highest = (
            (choices[row, 0], choices[column, 1]) for row, column in zip(rows, columns, strict=True)
        )
        return Reachable(Input(*map(float, lowest)), Input(*map(float, highest)))

    def _are_allowed(self, memory: Memory, inputs: Array) -> Booleans:
        """Which inputs (n, 2) keep to all lines, shape (n,)."""
        lines = list(self._lines.values())
        if not lines:
            return np.ones(len(inputs), np.bool_)
        normal, own = np.array([each.normal for each in lines]), np.array([each.own for each in lines])
        state, limits = memory.state(self._robot), self._array(self._robot)
        return which_allowed(state, inputs, limits, self._scene.step_s, normal, own)

    def _brake(self, memory: Memory, previous: Input) -> Input:
        """What always is allowed."""
        speed_mps = float(memory.state(self._robot)[3])
        return braking_input(self._limits, previous, speed_mps, self._scene.step_s)

    def _choices(self, previous: Input) -> Array:
        """Turn rates and accelerations (CHOICES, 2) that can be reached, from the lowest to the highest."""
        return np.linspace(*reachable_inputs(self._limits, previous, self._scene.step_s), CHOICES)

    @staticmethod
    def _away(inputs: Array, wanted: Input, choices: Array) -> Array:
        """How far inputs (n, 2) are from the wanted one, squared, in parts of what can be reached."""
        away: Array = (((inputs - np.array(wanted)) / np.ptp(choices, axis=0)) ** 2).sum(axis=1)
        return away

    def braking(self, memory: Memory, robot: str, driven: Input, steps: int) -> Array:
        """Positions (T + 1, 2) from the present on, if a robot drives an input some steps and then brakes.

        The steps begin when it was last seen, the present being the end of those that nobody saw.
        """
        unseen = 0 if robot == self._robot else memory.unseen_steps(robot)
        path, state = np.empty((self._steps + unseen + 2, 2)), memory.states(robot, unseen + 1)[0]
        contingency(state, np.array(driven), self._array(robot), self._scene.step_s, steps, path)
        return path[unseen:]

    def _stretch(self, memory: Memory, robot: str, previous: Input) -> tuple[Array, Array]:
        """The contingency (T + 1, 2) if the robot brakes since it was last seen, and if it goes on yet."""
        unseen = 0 if robot == self._robot else memory.unseen_steps(robot)
        brakes, goes_on = (self.braking(memory, robot, previous, steps) for steps in (0, unseen + 1))
        return brakes, goes_on

    def _beside_m(self, memory: Memory, robot: str, stretch: tuple[Array, Array]) -> Array:
        """How far (T + 1,) from its stretch a robot may be that was turning and began to brake unseen."""
        begin, way = stretch[0], stretch[1] - stretch[0]
        previous, length = memory.previous_input(robot), (way**2).sum(axis=1)
        most = np.zeros(len(begin))
        for steps in range(1, memory.unseen_steps(robot) + 1):
            away = self.braking(memory, robot, previous, steps) - begin
            share = np.clip((away * way).sum(axis=1) / np.where(length > 0.0, length, np.inf), 0.0, 1.0)
            most = np.maximum(most, np.linalg.norm(away - share[:, None] * way, axis=1))
        return most

    def _array(self, robot: str) -> Array:
        return _as_array(self._scene.robot(robot).limits, self._scene.step_s)

    def _has_crossed(self, memory: Memory, other: str, path: Array, accuracy: Accuracy) -> bool:
        """Whether another robot's present contingency is beyond its lines of the last step, and noise."""
        lines = self._lines.get(other)
        if lines is None or self._drawn != memory.step - 1 or memory.unseen_steps(other):
            return False
        beyond_m = float(((lines.normal[1:] * path[:-1]).sum(axis=1) - lines.other[1:]).max())
        stopping_s = self._steps * self._scene.step_s
        way_m = float(np.linalg.norm(path[-1] - path[0]))
        noise_m = accuracy.position_m + way_m * accuracy.heading_rad + stopping_s * accuracy.speed_mps
        return beyond_m > EXCUSED * self._scene.safety_margin_m + SIGMAS * noise_m


def braking_steps(limits: Limits, step_s: float) -> int:
    """The most steps in which a robot comes to a stand, whatever it drives; the last ones to settle."""
    ramp_s = 2.0 * limits.acceleration_mps2 / limits.jerk_mps3
    return math.ceil((limits.speed_mps / limits.acceleration_mps2 + ramp_s) / step_s) + 3


def _as_array(limits: Limits, step_s: float) -> Array:
    """Limits as :func:`contingency` takes them."""
    rates = limits.turn_acceleration_radps2 * step_s, limits.jerk_mps3 * step_s
    return np.array([limits.speed_mps, limits.turn_rate_radps, limits.acceleration_mps2, *rates])


def braking_path(state: Array, previous: Input, limits: Limits, step_s: float) -> Array:
    """Positions (n, 2), from the present one to the standstill that braking leads to."""
    path = np.empty((braking_steps(limits, step_s) + 1, 2))
    contingency(state, np.array(previous), _as_array(limits, step_s), step_s, 0, path)
    moves = np.abs(np.diff(path, axis=0)).max(axis=1) > STANDS_M
    return path[: 2 + int(np.flatnonzero(moves).max(initial=0))]


@kernel
def contingency(
    state: Array, previous: Array, limits: Array, step_s: float, driven: int, path: Array
) -> None:
    """Fill in the positions (T + 1, 2) of braking to a stand after an input was driven for some steps.

    Args:
        state: the present one, shape (4,).
        previous: the input (ω, a) that is driven first, or that led to the present state.
        limits: of speed, turn rate and acceleration, and of the changes of the last two in a step.
        step_s: Δt.
        driven: for how many steps the input is driven before braking begins.
        path: the result; whoever stands, stands to its end.
    """
    x, y, heading, speed = state[0], state[1], state[2], state[3]
    turn_rate = min(max(previous[0], -limits[1]), limits[1])
    acceleration = min(max(previous[1], -limits[2]), limits[2])
    path[0, 0], path[0, 1] = x, y
    for k in range(1, len(path)):
        x += step_s * speed * math.cos(heading)
        y += step_s * speed * math.sin(heading)
        path[k, 0], path[k, 1] = x, y
        if k > driven:
            wanted = settling_rate(-speed / step_s, limits[4])
            turn_rate = max(min(0.0, turn_rate + limits[3]), turn_rate - limits[3])
            wanted = max(min(wanted, acceleration + limits[4]), acceleration - limits[4])
            acceleration = min(max(wanted, -limits[2]), limits[2])
        heading += step_s * turn_rate
        after = min(max(speed + step_s * acceleration, -limits[0]), limits[0])
        acceleration = (after - speed) / step_s
        speed = after


@kernel
def parted(own: Array, own_on: Array, other: Array, other_on: Array, least_m: Array, seen: bool) -> Lines:
    """The lines of one pair: between contingencies (T + 1, 2), and those after going on.

    They leave a distance (T + 1,) between the two sides.

    Both may go as large a part of the way from braking at once to going on as leaves the distance between
    them; of a robot that is not seen, the whole way is kept clear. Where contingencies are nearer than the
    distance already, this robot may not come nearer still.
    """
    distances = np.empty(len(own))
    for k in range(len(own)):
        px, py, qx, qy = _nearest(own[k], own[k], other[k], other[k] if seen else other_on[k])
        distances[k] = min(math.hypot(px - qx, py - qy), least_m[k])
    low, high = 0.0, 1.0
    for halving in range(HALVINGS + 1):
        share = 1.0 if halving == 0 else 0.5 * (low + high)
        if _are_apart(own, own_on, other, other_on, distances, share, seen):
            low = share
        else:
            high = share
        if low == 1.0:
            break
    lines = Lines(np.empty((len(own), 2)), np.empty(len(own)), np.empty(len(own)))
    for k in range(len(own)):
        px, py, qx, qy = _shared(own[k], own_on[k], other[k], other_on[k], low, seen)
        x, y = px - qx, py - qy
        length = math.hypot(x, y)
        half = 0.5 * min(distances[k], length)
        if length == 0.0:  # one place: each keeps to the side where it is now
            x, y = own[0, 0] - other[0, 0], own[0, 1] - other[0, 1]
            length = math.hypot(x, y)
        if length > 0.0:
            x, y = x / length, y / length
        middle = 0.5 * (x * (px + qx) + y * (py + qy))
        lines.normal[k, 0], lines.normal[k, 1] = x, y
        lines.own[k], lines.other[k] = middle + half, middle - half
    return lines


@kernel
def _are_apart(
    own: Array, own_on: Array, other: Array, other_on: Array, distances: Array, share: float, seen: bool
) -> bool:
    for k in range(len(own)):
        px, py, qx, qy = _shared(own[k], own_on[k], other[k], other_on[k], share, seen)
        if (px - qx) ** 2 + (py - qy) ** 2 < distances[k] ** 2 * (1.0 - 1e-12):
            return False
    return True


@kernel
def _shared(
    own: Array, own_on: Array, other: Array, other_on: Array, share: float, seen: bool
) -> tuple[float, float, float, float]:
    """The nearest points of two stretches of which only a share counts; of a robot not seen, the whole."""
    return _nearest(
        own, own + share * (own_on - own), other, other + (share if seen else 1.0) * (other_on - other)
    )


@kernel
def _nearest(a: Array, a_on: Array, b: Array, b_on: Array) -> tuple[float, float, float, float]:
    """The nearest points of the stretches from ``a`` to ``a_on`` and from ``b`` to ``b_on``."""
    ux, uy, vx, vy = a_on[0] - a[0], a_on[1] - a[1], b_on[0] - b[0], b_on[1] - b[1]
    wx, wy = a[0] - b[0], a[1] - b[1]
    uu, uv, vv = ux * ux + uy * uy, ux * vx + uy * vy, vx * vx + vy * vy
    uw, vw = ux * wx + uy * wy, vx * wx + vy * wy
    across = uu * vv - uv * uv
    inner = (uv * vw - vv * uw) / across if across > 1e-12 * uu * vv else 0.0
    best, result = math.inf, (a[0], a[1], b[0], b[1])
    for begin in (inner, 0.0, 1.0):
        s = min(max(begin, 0.0), 1.0)
        t = min(max((vw + s * uv) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
        s = min(max((t * uv - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
        px, py, qx, qy = a[0] + s * ux, a[1] + s * uy, b[0] + t * vx, b[1] + t * vy
        away = (px - qx) ** 2 + (py - qy) ** 2
        if away < best:
            best, result = away, (px, py, qx, qy)
    return result


@kernel
def which_allowed(
    state: Array, inputs: Array, limits: Array, step_s: float, normal: Array, own: Array
) -> Booleans:
    """Of which inputs (n, 2) the contingency keeps to the own side of all lines, shape (n,).

    Args:
        state: the present one, shape (4,).
        inputs: to be driven now.
        limits: see :func:`contingency`.
        step_s: Δt.
        normal: of the lines of R others, shape (R, T + 1, 2).
        own: as in :class:`Lines`, shape (R, T + 1).
    """
    allowed, path = np.empty(len(inputs), np.bool_), np.empty(normal.shape[1:])
    for index in range(len(inputs)):
        contingency(state, inputs[index], limits, step_s, 1, path)
        allowed[index] = _keeps_to(path, normal, own)
    return allowed


def _combined(values: Array) -> Array:
    """Each turn rate with each acceleration of values (n, 2), shape (n², 2)."""
    return np.stack(np.meshgrid(values[:, 0], values[:, 1], indexing="ij"), axis=-1).reshape(-1, 2)


def largest_rectangle(allowed: Booleans, row: int, column: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """The rows and columns, first and last, of the largest all-true rectangle that holds a true cell."""
    best, found = 0, ((row, row), (column, column))
    for first in range(row + 1):
        for last in range(row, len(allowed)):
            free: Booleans = np.logical_and.reduce(allowed[first : last + 1], axis=0)
            if not free[column]:
                continue
            blocked = np.flatnonzero(~free)
            left = int(blocked[blocked < column].max(initial=-1)) + 1
            right = int(blocked[blocked > column].min(initial=len(free))) - 1
            size = (last - first + 1) * (right - left + 1)
            if size > best:
                best, found = size, ((first, last), (left, right))
    return found


@kernel
def _keeps_to(path: Array, normal: Array, own: Array) -> bool:
    for other in range(len(own)):
        for k in range(len(path)):
            along = normal[other, k, 0] * path[k, 0] + normal[other, k, 1] * path[k, 1]
            if along < own[other, k] - 1e-9 * (1.0 + abs(own[other, k])):
                return False
    return True
