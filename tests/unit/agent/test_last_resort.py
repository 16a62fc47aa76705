"""The last resort: when a robot brakes for one that is doubted."""

import math
from collections.abc import Callable

import numpy as np
from agent_helpers import STEP_S, euler, scene_of
from hypothesis import given
from hypothesis import strategies as st

from agent.drive.reserve import braking_path
from agent.drive.safety import LastResort, positions_ahead
from agent.remember.memory import Memory
from agent.solve.planning import Plan
from agent.solve.vehicle import Array
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input

LIMITS = Limits()
SPEEDS = st.floats(-LIMITS.speed_mps, LIMITS.speed_mps)
TURN_RATES = st.floats(-LIMITS.turn_rate_radps, LIMITS.turn_rate_radps)
HEADINGS = st.floats(-math.pi, math.pi)


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


def braking(state: Array, previous: Input) -> Array:
    """Positions (n, 2), long enough for anybody to stand."""
    path = braking_path(state, previous, LIMITS, STEP_S)
    return np.concatenate([path, np.tile(path[-1], (40, 1))])


class Drive:
    """Robot a under its last resort, which brakes instead when it is told to."""

    def __init__(self, actual: Way) -> None:
        self.scene = scene_of("ab")
        self.braked: list[int] = []
        self.least_m = math.inf
        self._last_resort = LastResort(self.scene, "a")
        self._memory = Memory(17, STEP_S)
        self._actual = actual

    def run(self, *, ignoring: int = 0) -> "Drive":
        """To the end; the first few orders to brake can be ignored."""
        state, previous = np.array(BEGIN), STANDSTILL
        for step in range(STEPS):
            other = self._actual(step)
            self.least_m = min(self.least_m, math.dist(state[:2], other[:2]))
            self._memory.remember(step, {"a": state, "b": other})
            plan = Plan(np.zeros((30, 2)), euler(tuple(state), [STANDSTILL] * 30), solved=True)
            later = np.concatenate([state[None, :2], braking(plan.states[1], STANDSTILL)])
            if self._last_resort.must_brake(self._memory, ["b"], plan, braking(state, previous), later):
                self.braked.append(step)
            if self.braked and step >= self.braked[0] + ignoring:
                previous = braking_input(LIMITS, previous, float(state[3]), STEP_S)
            else:
                previous = STANDSTILL
            state = euler(tuple(state), [previous])[-1]
        return self

    @property
    def collides(self) -> bool:
        return self.least_m < self.scene.collision_distance_m("a", "b")


def stopping_dead(step: int) -> tuple[float, float, float, float]:
    """It crosses the way of a well before it, but then stands there."""
    y_m = -4.0 + 0.3 * step
    return (2.0, y_m, math.pi / 2, 3.0) if y_m < -0.2 else (2.0, -0.2, math.pi / 2, 0.0)


def test_braking_for_who_stops_dead_keeps_clear_of_it_and_is_as_late_as_it_can_be():
    assert not Drive(stopping_dead).run().collides
    assert Drive(stopping_dead).run(ignoring=1).collides


def test_it_does_not_brake_for_who_is_out_of_the_way_in_time_nor_for_who_comes_from_behind():
    """Braking would bring the latter nearer yet."""
    crossing = Drive(lambda step: (2.0, -4.0 + 0.3 * step, math.pi / 2, 3.0)).run()
    assert (crossing.braked, crossing.collides) == ([], False)
    behind = Drive(lambda step: (-9.2 + 0.33 * step, 0.0, 0.0, 3.3)).run()
    assert min(behind.braked, default=STEPS) > 6
