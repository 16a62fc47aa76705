"""The kinematic gate believes all that a vehicle can do and little else; what perception makes of that."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from agent_helpers import STEP_S, enlarged, scene_of, seen
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP
from agent.remember.perception import REACQUIRED_AFTER, Gate, Perception
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
SCALES = st.sampled_from([0.02, 1.0, 10.0])
HELD = st.tuples(INPUTS, st.integers(1, 25))
TURN = LIMITS.turn_rate_radps
TIGHTEST = [Input(TURN, 3.0)] * 60 + [Input(TURN, -3.0)] * 30
"""The tightest turn at top speed, after it has been reached, and the strongest braking in it."""
DRIVES = st.lists(HELD, min_size=1, max_size=8).map(
    lambda parts: [wanted for wanted, steps in parts for _ in range(steps)]
)


def gate(limits: Limits = LIMITS) -> Gate:
    return Gate(STEP_S, lambda _: limits)


def driven(
    inputs: Sequence[Input], *, speed_mps: float = 0.0, heading_rad: float = 0.0, scale: float = 1.0
) -> list[State]:
    """As the world moves a vehicle that wants these inputs."""
    state, previous = VehicleState(0.0, 0.0, heading_rad, scale * speed_mps), STANDSTILL
    states = [State.of(*state)]
    for turn_rate, acceleration in inputs:
        wanted = Input(turn_rate, scale * acceleration)
        state, previous, _ = drive(enlarged(scale), state, previous, wanted, STEP_S)
        states.append(State.of(*state))
    return states


def state(
    x_m: float, y_m: float = 0.0, heading_rad: float = 0.0, speed_mps: float = 2.0, *, scale: float = 1.0
) -> State:
    return State(x_m=scale * x_m, y_m=scale * y_m, heading_rad=heading_rad, speed_mps=scale * speed_mps)


def straight(step: int, *, scale: float = 1.0) -> State:
    """Along x."""
    return state(2.0 * STEP_S * step, scale=scale)


def judged(by: Gate, states: Sequence[State], first: int = 0, accuracy: Accuracy = EXACT) -> list[str]:
    """What becomes of states that are seen at consecutive steps."""
    return [by.judge("a", first + step, each, accuracy) for step, each in enumerate(states)]


def watching(steps: int = 5, scale: float = 1.0) -> Gate:
    """A gate that has seen a robot drive straight on until the step before this one."""
    begun = gate(enlarged(scale))
    assert judged(begun, [straight(step, scale=scale) for step in range(steps)]) == [BELIEVED] * steps
    return begun


@settings(max_examples=50)
@example(TIGHTEST, 0.0, 0.0, [1] * 90, 10.0)
@example(TIGHTEST, 0.0, 0.0, [LONGEST_GAP] * 9, 0.02)
@given(
    DRIVES,
    st.floats(-LIMITS.speed_mps, LIMITS.speed_mps),
    st.floats(-math.pi, math.pi),
    st.just([1] * 200) | st.lists(st.integers(1, LONGEST_GAP), min_size=1, max_size=60),
    SCALES,
)
def test_whatever_a_vehicle_drives_is_believed_also_what_nobody_saw(
    inputs, speed_mps, heading_rad, gaps, scale
):
    """However large it is, and however small."""
    states = driven(inputs, speed_mps=speed_mps, heading_rad=heading_rad, scale=scale)
    by = gate(enlarged(scale))
    seen = [step for step in np.cumsum([0, *gaps]).tolist() if step < len(states)]
    assert {by.judge("a", step, states[step], EXACT) for step in seen} == {BELIEVED}


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
    errors = np.random.default_rng(seed).normal(size=(len(states), 4)) * accuracy.as_tuple()
    measured = np.array([true.as_tuple() for true in states]) + errors
    judgements = judged(gate(), [State.of(*each) for each in measured.tolist()], accuracy=accuracy)
    assert len(judgements) - judgements.count(BELIEVED) <= 0.01 * len(judgements)


@pytest.mark.parametrize("scale", [0.02, 1.0, 10.0])
@pytest.mark.parametrize(
    "told",
    [(2.0,), (1.0, -0.6), (1.0, 0.0, 0.0, 3.0), (1.0, 0.0, 0.0, -2.0), (1.0, 0.0, 0.4), (1.0, 0.0, -math.pi)],
    ids=["ahead", "aside", "much faster", "backwards at once", "turned too far", "turned round"],
)
def test_what_no_vehicle_can_do_in_a_step_is_refused(told, scale):
    by = watching(scale=scale)
    assert by.judge("a", 5, state(*told, scale=scale), EXACT) == REFUSED
    on = straight(6, scale=scale)
    assert by.judge("a", 6, on, EXACT) == BELIEVED, "what comes next is judged by what was believed"


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
    told = [state(50.0 + 0.2 * step) for step in range(2 * REACQUIRED_AFTER - 1)]
    told[REACQUIRED_AFTER - 1] = straight(5 + REACQUIRED_AFTER - 1)
    refused = [REFUSED] * (REACQUIRED_AFTER - 1)
    assert judged(watching(), told, first=5) == [*refused, BELIEVED, *refused]


def test_neither_an_old_view_nor_one_after_a_long_gap_is_a_jump():
    """Old views come when delays differ from step to step; after a gap nothing is known to hold against."""
    by = watching()
    assert by.judge("a", 2, state(50.0), EXACT) == BELIEVED
    assert by.judge("a", 5, straight(5), EXACT) == BELIEVED
    assert watching().judge("a", 4 + LONGEST_GAP, state(50.0), EXACT) == REFUSED
    assert watching().judge("a", 4 + LONGEST_GAP + 1, state(50.0), EXACT) == BELIEVED


A = (0.0, 0.0, 0.0, 2.0)
B = (5.0, 5.0, 0.0, 0.0)
ELSEWHERE = (-5.0, 5.0, 1.0, 0.0)


def test_who_is_believed_anew_is_known_from_then_on_only():
    perception = Perception(scene_of("ab"), "a")
    own = [(0.2 * step, *A[1:]) for step in range(9)]
    for step in range(4):
        assert perception.take_in(seen(step, {"a": own[step], "b": B}), None) == set()
    for step in range(4, 3 + REACQUIRED_AFTER):
        assert perception.take_in(seen(step, {"a": own[step], "b": ELSEWHERE}), None) == {"b"}
        assert perception.memory.state("b").tolist() == list(B)
    step = 3 + REACQUIRED_AFTER
    assert perception.take_in(seen(step, {"a": own[step], "b": ELSEWHERE}), None) == set()
    assert perception.memory.states("b", 99).tolist() == [list(ELSEWHERE)]


@pytest.mark.parametrize("missed", [0, 3])
def test_an_own_pose_that_is_refused_is_replaced_by_where_its_inputs_have_led_it(missed):
    """Also over steps of which it saw nothing: it is taken to have driven the same at all of them."""
    perception = Perception(scene_of("ab"), "a")
    perception.take_in(seen(0, {"a": A}), None)
    steps = 1 + missed
    refused = perception.take_in(seen(steps, {"a": (9.0, 9.0, 0.0, 0.0)}), Input(0.0, 1.0))
    assert refused == {"a"}
    way_m = sum(0.1 * (2.0 + 0.1 * step) for step in range(steps))
    assert perception.memory.state("a") == pytest.approx((way_m, 0.0, 0.0, 2.0 + 0.1 * steps))
    assert perception.memory.unseen_steps("a") == 0
    unknowing = Perception(scene_of("ab"), "a")
    unknowing.take_in(seen(0, {"a": A}), None)
    assert unknowing.take_in(seen(1, {"a": (9.0, 9.0, 0.0, 0.0)}), None) == {"a"}
    assert unknowing.memory.unseen_steps("a") == 1, "without a known input it is not seen"


def test_the_view_of_others_is_judged_at_the_step_of_which_it_is():
    """A robot at 4 m/s is 0.8 m on after two steps, which it could not be after one."""
    perception = Perception(scene_of("ab"), "a")
    perception.take_in(seen(5, {"a": A, "b": (0.0, 5.0, 0.0, 4.0)}), None)
    late = seen(8, {"a": (0.6, *A[1:]), "b": (0.8, 5.0, 0.0, 4.0)}, age_steps=1)
    assert perception.take_in(late, None) == set()
    assert perception.memory.unseen_steps("b") == 1
