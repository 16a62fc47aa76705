"""Plans that arrive early: a count from above, in least time, and into a pose beside which a robot stands."""

import math

import numpy as np
import pytest
from agent_helpers import NEVER, SOLVERS, STEP_S, euler, free, remembered, scene_of
from hypothesis import given
from hypothesis import strategies as st

from agent.solve.arrival import EarlyPlanner, arrival_weights, stages_away
from agent.solve.prediction import Prediction
from agent.solve.vehicle import Array
from protocol.vehicle import STANDSTILL, Input, has_arrived

NOBODY = Prediction(paths={}, inputs={}, starts={}, states={}, sides={}, solved=True)
GOAL = np.zeros(4)
TOLERANCE = 0.1
"""Of arriving; the default."""

units = st.tuples(*[st.floats(0.01, 10.0)] * 2)


@given(st.integers(0, 2**32 - 1), st.floats(1e-2, 10.0), units, st.floats(1e-3, 1e3))
def test_the_weighted_squares_lie_above_the_count_and_touch_it_where_they_were_made(
    seed, sharp_m, measures, price
):
    """Up to the factor that keeps prices what they are."""
    random = np.random.default_rng(seed)
    known, other = 10.0 ** random.uniform(-3, 1, (2, 20, 1)) * random.normal(size=(2, 20, 4))
    goal, unit = random.normal(size=4), np.array([1.0, 1.0, *measures])
    weights = arrival_weights(np.full((20, 4), price), goal + known, goal, unit, sharp_m)
    assert weights[1:, 0].mean() == pytest.approx(price)
    factor = weights[0, 0] * (sharp_m**2 + ((unit * known[0]) ** 2).sum()) ** 2 / sharp_m**2

    def above(away: Array) -> float:
        return float((weights * (away**2 - known**2)).sum() / factor)

    count = stages_away(goal + known, goal, unit, sharp_m)
    assert above(known) == 0.0
    assert stages_away(goal + other, goal, unit, sharp_m) <= count + above(other) + 1e-9 * (1 + above(other))


def driven(state: tuple[float, float, float, float], seconds: float = 10.0) -> Array:
    """The states up to the arrival of a robot alone, or as long as it may take."""
    memory, scene, previous = remembered({"a": np.array([state])}), scene_of("a"), STANDSTILL
    planner = EarlyPlanner(scene, "a", SOLVERS["realtime"], NEVER)
    states = [memory.state("a")]
    while not has_arrived(states[-1].tolist(), GOAL.tolist(), TOLERANCE) and memory.step * STEP_S < seconds:
        plan = planner.plan(memory, GOAL, previous, NOBODY, free)
        assert plan.solved
        previous = Input(*plan.inputs[0].tolist())
        memory.remember(memory.step + 1, {"a": euler(states[-1], [previous])[1]})
        states.append(memory.state("a"))
    assert has_arrived(states[-1].tolist(), GOAL.tolist(), TOLERANCE)
    return np.array(states)


@pytest.mark.parametrize(("way_m", "least_s", "more_s"), [(8.0, 3.5, 0.2), (19.0, 5.7, 0.4)])
def test_alone_and_straight_a_robot_takes_little_more_than_the_least_time(way_m, least_s, more_s):
    """Which follows from the limits, for a stand at the goal itself."""
    assert (len(driven((-way_m, 0.0, 0.0, 0.0))) - 1) * STEP_S <= least_s + more_s


def test_a_robot_arrives_aligned_from_wherever_it_comes():
    random, settling_s = np.random.default_rng(5), []
    for _ in range(12):
        start = random.uniform([-7.0, -1.5, -1.2, 0.0], [-2.0, 1.5, 1.2, 3.0])
        states = driven(tuple(start.tolist()))
        near = np.flatnonzero(np.linalg.norm(states[:, :2], axis=1) < 0.5)[0]
        settling_s.append((len(states) - 1 - near) * STEP_S)
    assert np.mean(settling_s) <= 0.9


@pytest.mark.parametrize("beside_m", [0.13, 0.26, -0.4])
def test_who_stands_beside_its_goal_drives_there_and_back(beside_m):
    """Which no change of a standing robot's plan makes better, to first order."""
    states = driven((0.0, beside_m, 0.0, 0.0), seconds=6.0)
    assert np.abs(states[:, 0]).max() > 0.1
    assert math.isclose(states[-1, 2], 0.0, abs_tol=TOLERANCE)
