"""The last resort: what it takes others to do, and when it brakes for them."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from agent_helpers import STEP_S, euler, scene_of
from hypothesis import given
from hypothesis import strategies as st

from agent.drive.safety import CollisionMonitor, braking_path, positions_ahead
from agent.remember.memory import Memory
from agent.solve.planning import Plan
from agent.solve.vehicle import Array
from protocol.messages import Accuracy
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input

LIMITS = Limits()
EXACT = Accuracy()
SPEEDS = st.floats(-LIMITS.speed_mps, LIMITS.speed_mps)
TURN_RATES = st.floats(-LIMITS.turn_rate_radps, LIMITS.turn_rate_radps)
ACCELERATIONS = st.floats(-LIMITS.acceleration_mps2, LIMITS.acceleration_mps2)
HEADINGS = st.floats(-math.pi, math.pi)


@given(HEADINGS, SPEEDS, st.builds(Input, TURN_RATES, ACCELERATIONS), st.sampled_from([0.05, 0.1, 0.25]))
def test_the_braking_path_is_what_braking_at_every_step_drives_and_ends_standing(
    heading, speed, previous, step_s
):
    begin = np.array([1.0, -2.0, heading, speed])
    path = braking_path(begin, previous, LIMITS, step_s)
    inputs, driven = [], speed
    for _ in path[1:]:
        previous = braking_input(LIMITS, previous, driven, step_s)
        driven += step_s * previous.acceleration_mps2
        inputs.append(previous)
    np.testing.assert_allclose(path, euler(tuple(begin), inputs, step_s), atol=1e-9)
    assert abs(path[-1, 3]) < 1e-9
    assert abs(inputs[-1].acceleration_mps2) < 1e-9


@given(HEADINGS, SPEEDS, TURN_RATES, st.just(0.0) | st.floats(0.1, LIMITS.acceleration_mps2))
def test_positions_ahead_are_those_of_robots_that_go_on_or_slow_down_until_they_stand(
    heading, speed, turn_rate, slowing
):
    inputs, left = [], abs(speed)
    for _ in range(60):
        less = min(slowing, left / STEP_S)
        left -= STEP_S * less
        inputs.append((turn_rate, -math.copysign(less, speed)))
    begin = (3.0, -1.0, heading, speed)
    both, turns, losses = np.array([begin, (5.0, 5.0, 1.0, 2.0)]), np.array([turn_rate, 0.5]), [slowing, 1.0]
    ways = positions_ahead(both, turns, np.array(losses), 61, STEP_S)
    assert ways.shape == (2, 61, 2)
    np.testing.assert_allclose(ways[0], euler(begin, inputs)[:, :2], atol=1e-9)


BEGIN = (-8.0, 0.0, 0.0, 3.0)
"""Of robot a, which wants to drive straight on along x."""
STEPS = 60
Way = Callable[[int], tuple[float, float, float, float]]
"""The state of robot b by the step."""


class Drive:
    """Robot a under its monitor, which brakes instead when it is told to."""

    def __init__(
        self,
        actual: Way,
        expected: Callable[[tuple[float, float, float, float]], Array],
        accuracy: Accuracy = EXACT,
    ) -> None:
        self.scene = scene_of("ab")
        self.monitor = CollisionMonitor(self.scene, "a")
        self.braked: list[int] = []
        self.least_m = math.inf
        self._memory = Memory(17, STEP_S)
        self._actual = actual
        self._expected = expected
        self._accuracy = accuracy

    def run(self, *, obey: bool = True, ignoring: int = 0) -> "Drive":
        """To the end; the first few orders to brake can be ignored."""
        state, previous = np.array(BEGIN), STANDSTILL
        for step in range(STEPS):
            other = self._actual(step)
            self.least_m = min(self.least_m, math.dist(state[:2], other[:2]))
            self._memory.remember(step, {"a": state, "b": other})
            paths: dict[str, Any] = {"b": self._expected(other)}
            prediction: Any = SimpleNamespace(solved=True, paths=paths)
            self.monitor.watch(self._memory, prediction, self._accuracy)
            plan = Plan(np.zeros((30, 2)), euler(tuple(state), [STANDSTILL] * 30), solved=True)
            if self.monitor.must_brake(self._memory, plan, STANDSTILL, previous):
                self.braked.append(step)
            if self.braked and obey and step >= self.braked[0] + ignoring:
                previous = braking_input(LIMITS, previous, float(state[3]), STEP_S)
            else:
                previous = STANDSTILL
            state = euler(tuple(state), [previous])[-1]
        return self

    @property
    def collides(self) -> bool:
        return self.least_m < self.scene.collision_distance_m("a", "b")


def going_on(state: tuple[float, float, float, float]) -> Array:
    """Everybody expects b to keep its speed and its heading."""
    return euler(state, [STANDSTILL] * 30)[:, :2]


def stopping_dead(step: int) -> tuple[float, float, float, float]:
    """It crosses the way of a well before it, but then stands there."""
    y_m = -4.0 + 0.3 * step
    return (2.0, y_m, math.pi / 2, 3.0) if y_m < -0.2 else (2.0, -0.2, math.pi / 2, 0.0)


def staying_on_its_way(step: int) -> tuple[float, float, float, float]:
    """It comes towards a."""
    return (6.0 - 0.1 * step, 0.5, math.pi, 1.0)


def turning_away(state: tuple[float, float, float, float]) -> Array:
    """What it ought to do in time."""
    return euler(state, [(-1.0, 0.0)] * 30)[:, :2]


@pytest.mark.parametrize(
    ("actual", "expected"),
    [(stopping_dead, lambda state: going_on((*state[:3], 3.0))), (staying_on_its_way, turning_away)],
    ids=["stops dead", "does not turn"],
)
def test_who_does_not_do_as_expected_is_braked_for_once_and_not_without_need(actual, expected):
    drive = Drive(actual, expected).run()
    assert drive.braked
    assert drive.monitor.interventions == 1
    assert Drive(actual, expected).run(obey=False).collides


def test_braking_for_who_stops_dead_keeps_clear_of_it_and_is_as_late_as_it_can_be():
    def drive(ignoring: int) -> Drive:
        return Drive(stopping_dead, lambda state: going_on((*state[:3], 3.0))).run(ignoring=ignoring)

    assert not drive(0).collides
    assert drive(1).collides


@pytest.mark.parametrize(
    "actual", [lambda _: (2.0, -0.2, 0.0, 0.0), staying_on_its_way], ids=["stands", "goes on"]
)
def test_nobody_is_braked_for_who_does_as_expected(actual):
    """Whether that ends well is a matter of those who have agreed on it."""
    drive = Drive(actual, going_on).run(obey=False)
    assert drive.collides
    assert drive.braked == []
    assert drive.monitor.interventions == 0


@pytest.mark.parametrize(
    ("accuracy", "is_doubted"), [(EXACT, True), (Accuracy(position_m=0.1, speed_mps=0.1), False)]
)
def test_what_noise_explains_is_no_departure(accuracy, is_doubted):
    drive = Drive(lambda step: (2.0, 0.1 * (step % 3), math.pi / 2, 0.0), going_on, accuracy)
    assert bool(drive.run().braked) == is_doubted
