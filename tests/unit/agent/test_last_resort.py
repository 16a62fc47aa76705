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
Place = tuple[float, float, float, float]


def braking(state: Array, previous: Input) -> Array:
    """Positions (n, 2), long enough for anybody to stand."""
    path = braking_path(state, previous, LIMITS, STEP_S)
    return np.concatenate([path, np.tile(path[-1], (40, 1))])


def drive(actual: Callable[[int], Place], ignoring: int = 0) -> tuple[list[int], bool]:
    """At which steps a, doubting b, is told to brake, and whether they collide; it ignores some orders."""
    scene, memory = scene_of("ab"), Memory(17, STEP_S)
    last_resort, state, previous, braked, gaps_m = LastResort(scene, "a"), np.array(BEGIN), STANDSTILL, [], []
    for step in range(STEPS):
        memory.remember(step, {"a": state, "b": actual(step)})
        gaps_m.append(math.dist(state[:2], actual(step)[:2]))
        plan = Plan(np.zeros((30, 2)), euler(tuple(state), [STANDSTILL] * 30), solved=True)
        later = np.concatenate([state[None, :2], braking(plan.states[1], STANDSTILL)])
        if last_resort.must_brake(memory, ["b"], plan, braking(state, previous), later):
            braked.append(step)
        brakes = bool(braked) and step >= braked[0] + ignoring
        previous = braking_input(LIMITS, previous, float(state[3]), STEP_S) if brakes else STANDSTILL
        state = euler(tuple(state), [previous])[-1]
    return braked, min(gaps_m) < scene.collision_distance_m("a", "b")


def stopping_dead(step: int) -> Place:
    """It crosses the way of a well before it, but then stands there."""
    y_m = -4.0 + 0.3 * step
    return (2.0, y_m, math.pi / 2, 3.0) if y_m < -0.2 else (2.0, -0.2, math.pi / 2, 0.0)


def test_braking_for_who_stops_dead_keeps_clear_of_it_and_is_as_late_as_it_can_be():
    assert [drive(stopping_dead, ignoring)[1] for ignoring in (0, 1)] == [False, True]


def test_it_does_not_brake_for_who_is_out_of_the_way_in_time_nor_for_who_comes_from_behind():
    """Braking would bring the latter nearer yet."""
    assert drive(lambda step: (2.0, -4.0 + 0.3 * step, math.pi / 2, 3.0)) == ([], False)
    braked, _ = drive(lambda step: (-9.2 + 0.33 * step, 0.0, 0.0, 3.3))
    assert min(braked, default=STEPS) > 6
