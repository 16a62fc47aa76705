"""What the kinematic gate believes: everything that a vehicle can do, and little else."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP
from agent.remember.perception import REACQUIRED_AFTER, Gate
from protocol.messages import Accuracy, State
from protocol.vehicle import STANDSTILL, Input, Limits
from world.vehicle import VehicleState, drive

LIMITS = Limits()
EXACT = Accuracy()
BELIEVED, REFUSED, REACQUIRED = "believed", "refused", "reacquired"
FRACTIONS = st.floats(-1.0, 1.0)
INPUTS = st.tuples(FRACTIONS, FRACTIONS).map(
    lambda each: Input(2.0 * each[0] * LIMITS.turn_rate_radps, 2.0 * each[1] * LIMITS.acceleration_mps2)
)
"""Wanted ones; the vehicle drives what its limits make of them."""
HELD = st.tuples(INPUTS, st.integers(1, 25))
DRIVES = st.lists(HELD, min_size=1, max_size=8).map(
    lambda parts: [wanted for wanted, steps in parts for _ in range(steps)]
)


def gate() -> Gate:
    return Gate(STEP_S, lambda _: LIMITS)


def driven(inputs: Sequence[Input], *, speed_mps: float = 0.0, heading_rad: float = 0.0) -> list[State]:
    """As the world moves a vehicle that wants these inputs."""
    state, previous = VehicleState(0.0, 0.0, heading_rad, speed_mps), STANDSTILL
    states = [State.of(*state)]
    for wanted in inputs:
        state, previous, _ = drive(LIMITS, state, previous, wanted, STEP_S)
        states.append(State.of(*state))
    return states


def state(x_m: float, y_m: float = 0.0, heading_rad: float = 0.0, speed_mps: float = 2.0) -> State:
    return State(x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=speed_mps)


def straight(step: int, speed_mps: float = 2.0) -> State:
    """Along x."""
    return state(speed_mps * STEP_S * step, speed_mps=speed_mps)


def judged(by: Gate, states: Sequence[State], first: int = 0, accuracy: Accuracy = EXACT) -> list[str]:
    """What becomes of states that are seen at consecutive steps."""
    return [by.judge("a", first + step, each, accuracy) for step, each in enumerate(states)]


def watching(steps: int = 5) -> Gate:
    """A gate that has seen a robot drive straight on until the step before this one."""
    begun = gate()
    assert judged(begun, [straight(step) for step in range(steps)]) == [BELIEVED] * steps
    return begun


def measured(states: Sequence[State], accuracy: Accuracy, seed: int) -> list[State]:
    """With noise of the standard deviations told."""
    errors = np.random.default_rng(seed).normal(size=(len(states), 4)) * accuracy.as_tuple()
    return [
        State.of(*(np.array(true.as_tuple()) + off).tolist())
        for true, off in zip(states, errors, strict=True)
    ]


@settings(max_examples=50)
@given(
    DRIVES,
    st.floats(-LIMITS.speed_mps, LIMITS.speed_mps),
    st.floats(-math.pi, math.pi),
    st.just([1] * 200) | st.lists(st.integers(1, LONGEST_GAP), min_size=1, max_size=60),
)
def test_whatever_a_vehicle_drives_is_believed_also_what_nobody_saw(inputs, speed_mps, heading_rad, gaps):
    states, by = driven(inputs, speed_mps=speed_mps, heading_rad=heading_rad), gate()
    seen = [step for step in np.cumsum([0, *gaps]).tolist() if step < len(states)]
    assert {by.judge("a", step, states[step], EXACT) for step in seen} == {BELIEVED}


@pytest.mark.parametrize("gap", range(1, LONGEST_GAP + 1))
@pytest.mark.parametrize("forwards", [1.0, -1.0])
def test_the_tightest_turn_at_top_speed_is_believed(gap, forwards):
    """After it has been reached; and the strongest braking in it."""
    turning = Input(LIMITS.turn_rate_radps, forwards * LIMITS.acceleration_mps2)
    braking = turning._replace(acceleration_mps2=-turning.acceleration_mps2)
    states, by = driven([turning] * 60 + [braking] * 30), gate()
    assert {by.judge("a", step, states[step], EXACT) for step in range(0, 91, gap)} == {BELIEVED}


@settings(max_examples=15)
@given(
    st.lists(HELD, min_size=8, max_size=8),
    st.floats(0.0, 0.2),
    st.floats(0.0, 0.1),
    st.floats(0.0, 0.3),
    st.integers(0, 2**32),
)
def test_noise_of_the_told_accuracy_is_hardly_ever_refused(held, position_m, heading_rad, speed_mps, seed):
    states = driven([wanted for wanted, steps in held for _ in range(steps)])
    accuracy = Accuracy(position_m=position_m, heading_rad=heading_rad, speed_mps=speed_mps)
    judgements = judged(gate(), measured(states, accuracy, seed), accuracy=accuracy)
    assert len(judgements) - judgements.count(BELIEVED) <= 0.01 * len(judgements)


@pytest.mark.parametrize(
    "told",
    [
        state(1.0 + 1.0),
        state(1.0, y_m=-0.6),
        state(1.0, speed_mps=2.0 + 1.0),
        state(1.0, speed_mps=-2.0),
        state(1.0, heading_rad=0.4),
        state(1.0, heading_rad=-math.pi),
    ],
    ids=["ahead", "aside", "much faster", "backwards at once", "turned too far", "turned round"],
)
def test_what_no_vehicle_can_do_in_a_step_is_refused(told):
    by = watching()
    assert by.judge("a", 5, told, EXACT) == REFUSED
    assert by.judge("a", 6, straight(6), EXACT) == BELIEVED, "what comes next is judged by what was believed"


def test_a_robot_whose_place_stays_while_it_says_that_it_moves_is_refused():
    """Of a frozen view, once it is off by more than acceleration and margins explain."""
    judgements = judged(watching(), [straight(4)] * 6, first=5)
    assert judgements[0] == REFUSED or judgements[1] == REFUSED
    assert REACQUIRED not in judgements, "a place held at speed does not fit itself"


def test_nobody_is_believed_to_be_faster_than_its_limits():
    fast = LIMITS.speed_mps + 0.5
    told = [state(fast * STEP_S * step, speed_mps=fast) for step in range(20)]
    judgements = judged(gate(), told)
    assert judgements[0] == BELIEVED, "there is nothing to hold a first sighting against"
    assert set(judgements[1:]) == {REFUSED}


def test_after_several_sightings_that_fit_one_another_a_robot_is_there():
    by, elsewhere = watching(), [state(3.0 + 0.2 * step, y_m=5.0) for step in range(6)]
    judgements = judged(by, elsewhere, first=5)
    assert judgements == [REFUSED] * (REACQUIRED_AFTER - 1) + [REACQUIRED] + [BELIEVED] * 3
    assert by.judge("a", 11, straight(11), EXACT) == REFUSED, "it is no longer where it was before"


@settings(max_examples=20)
@given(
    st.lists(st.tuples(st.floats(4.0, 8.0), st.floats(-1.5, 1.5)), min_size=2 * LONGEST_GAP, max_size=40),
    st.integers(1, 3),
)
def test_sightings_that_do_not_fit_one_another_are_never_believed(jumps, every):
    """However long they go on, each jumps from the one before, away from where the robot drives."""
    ways = [(jump_m * math.cos(at_rad), jump_m * math.sin(at_rad)) for jump_m, at_rad in jumps]
    told = [state(100.0 + x, y) for x, y in np.cumsum(ways, axis=0).tolist()]
    by = watching()
    judgements = {by.judge("a", 5 + every * index, each, EXACT) for index, each in enumerate(told)}
    assert judgements == {REFUSED}


def test_a_refusal_counts_only_in_a_row():
    """One sighting that is believed in between, and those that are refused later begin anew."""
    by, away = watching(), [state(50.0 + 0.2 * step) for step in range(10)]
    assert judged(by, away[: REACQUIRED_AFTER - 1], first=5) == [REFUSED] * (REACQUIRED_AFTER - 1)
    step = 5 + REACQUIRED_AFTER - 1
    assert by.judge("a", step, straight(step), EXACT) == BELIEVED
    assert judged(by, away[REACQUIRED_AFTER:][: REACQUIRED_AFTER - 1], first=step + 1) == [REFUSED] * (
        REACQUIRED_AFTER - 1
    )


def test_neither_an_old_view_nor_one_after_a_long_gap_is_a_jump():
    """Old views come when delays differ from step to step; after a gap nothing is known to hold against."""
    by = watching()
    assert by.judge("a", 2, state(50.0), EXACT) == BELIEVED
    assert by.judge("a", 5, straight(5), EXACT) == BELIEVED
    assert watching().judge("a", 4 + LONGEST_GAP, state(50.0), EXACT) == REFUSED
    assert watching().judge("a", 4 + LONGEST_GAP + 1, state(50.0), EXACT) == BELIEVED
