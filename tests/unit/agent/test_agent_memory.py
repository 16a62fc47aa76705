"""What a robot remembers, with observations missing, late, repeated and crossing ±π."""

import math

import numpy as np
import pytest
from agent_helpers import STEP_S
from hypothesis import given
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP, MOST_CAUTION_M, Memory
from protocol.vehicle import STANDSTILL, Limits, wrap_angle

WINDOW = 17
State = tuple[float, float, float, float]


def moving(step: int, *, speed: float = 2.0) -> State:
    """Along x from the origin, as eq. 8 with a constant speed has it."""
    return (speed * STEP_S * step, 0.0, 0.0, speed)


def memory_of(steps: int, *robots: str) -> Memory:
    memory = Memory(WINDOW, STEP_S)
    for step in range(steps):
        assert memory.remember(step, dict.fromkeys(robots, moving(step)))
    return memory


def snapshot(memory: Memory) -> tuple[int, dict[str, list[list[float]]]]:
    return memory.step, {robot: memory.states(robot, 100).tolist() for robot in memory.robots}


@given(st.permutations([*range(12), *range(3)]))
def test_old_repeated_and_out_of_order_steps_change_nothing(order):
    """Only those steps count that are newer than all before them."""
    shuffled, in_order = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    for place, step in enumerate(order):
        newest = step > max(order[:place], default=-1)
        states = {"a": moving(step)} if newest else {"a": moving(99), "new": moving(0)}
        assert shuffled.remember(step, states) == newest
        if newest:
            in_order.remember(step, states)
        assert snapshot(shuffled) == snapshot(in_order)


def test_only_the_window_is_remembered():
    memory = memory_of(3 * WINDOW, "a")
    states = memory.states("a", 10 * WINDOW)
    assert states.tolist() == [list(moving(step)) for step in range(2 * WINDOW, 3 * WINDOW)]
    assert memory.states("a", 3).tolist() == states[-3:].tolist()
    assert memory.state("a").tolist() == memory.present()["a"].tolist() == states[-1].tolist()


@given(
    st.floats(-math.pi, math.pi),
    st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=WINDOW - 1),
)
def test_headings_observed_in_one_turn_are_remembered_without_jumps(start, changes):
    """Headings wrapped by the world come back as the continuous ones, up to the turns before the first."""
    true = start + np.concatenate([[0.0], np.cumsum(changes)])
    memory = Memory(WINDOW, STEP_S)
    for step, heading in enumerate(true):
        memory.remember(step, {"a": (0.0, 0.0, wrap_angle(heading), 0.0)})
    remembered = memory.states("a", WINDOW)[:, 2]
    np.testing.assert_allclose(remembered - remembered[0], true - true[0], atol=1e-9)


def test_the_last_input_is_recovered_across_half_a_turn():
    memory = Memory(WINDOW, STEP_S)
    memory.remember(0, {"a": (0.0, 0.0, math.pi - 0.05, 1.0)})
    assert memory.previous_input("a") == STANDSTILL
    memory.remember(1, {"a": (0.1, 0.0, -math.pi + 0.05, 0.8)})
    assert memory.previous_input("a") == pytest.approx((1.0, -2.0))


@pytest.mark.parametrize("gap", [1, LONGEST_GAP])
@pytest.mark.parametrize("skipped", [False, True], ids=["not seen", "steps skipped"])
def test_a_gap_is_filled_by_interpolation_the_nearer_way_round_once_the_robot_is_seen_again(gap, skipped):
    memory = Memory(WINDOW, STEP_S)
    memory.remember(0, {"a": (0.0, 0.0, 3.0, 1.0)})
    for step in () if skipped else range(1, gap + 1):
        memory.remember(step, {})
    memory.remember(gap + 1, {"a": (2.0, 3.0, -3.0, 0.0)})
    begin, end = (0.0, 0.0, 3.0, 1.0), (2.0, 3.0, math.tau - 3.0, 0.0)
    expected = np.linspace(begin, end, gap + 2)
    np.testing.assert_allclose(memory.states("a", 100), expected, atol=1e-12)


def test_a_robot_that_comes_back_after_too_long_or_that_was_forgotten_begins_anew():
    """Nothing before is mixed with what is seen now."""
    memory, back = memory_of(30, "a", "b", "c"), (5.0, 5.0, 1.0, 0.5)
    memory.forget("b")
    memory.forget("stranger")
    assert memory.robots == ["a", "c"]
    for step, robot in ((30, "b"), (31 + LONGEST_GAP, "a")):
        memory.remember(step, {robot: back})
        assert memory.states(robot, 100).tolist() == [list(back)]
        assert memory.previous_input(robot) == STANDSTILL


@given(st.lists(st.tuples(st.integers(1, 2 * LONGEST_GAP), st.booleans()), min_size=1, max_size=12))
def test_every_pattern_of_sightings_keeps_consecutive_states_that_agree_with_them(pattern):
    """A robot at a constant speed: guesses, interpolations and sightings are then all the same.

    Unseen for longer than ``LONGEST_GAP`` it is gone, whether or not observations came meanwhile.
    """
    memory = Memory(WINDOW, STEP_S)
    memory.remember(0, {"a": moving(0)})
    step, last = 0, 0
    for passed, is_seen in pattern:
        step += passed
        memory.remember(step, {"a": moving(step)} if is_seen else {})
        last = step if is_seen else last
        assert memory.robots == (["a"] if step - last <= LONGEST_GAP else [])
        if memory.robots:
            states = memory.states("a", 100)
            assert len(states) <= WINDOW
            np.testing.assert_allclose(
                states, [moving(k) for k in range(step + 1 - len(states), step + 1)], atol=1e-9
            )


def test_robots_join_at_any_step_and_their_order_does_not_depend_on_who_came_first():
    one, other = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    for step, ids in enumerate(("c", "ca", "bca")):
        one.remember(step, dict.fromkeys(ids, moving(step)))
    other.remember(0, dict.fromkeys("bac", moving(0)))
    assert one.robots == other.robots == ["a", "b", "c"]
    assert [len(one.states(robot, 100)) for robot in one.robots] == [2, 1, 3]


def unseen_for(steps: int, *, limits: Limits | None = None, age_steps: int = 0) -> Memory:
    """A robot that sees itself always, and b no more since step 3."""
    memory = Memory(17, STEP_S, owner="a", limits_of=lambda _: limits or Limits())
    for step in range(4 + steps):
        seen = {"a": moving(0)} | ({"b": moving(0)} if step < 4 else {})
        memory.remember(step, seen, age_steps=min(step, age_steps) if step < 4 else age_steps)
    return memory


@pytest.mark.parametrize(("steps", "age_steps"), [(0, 0), (1, 0), (LONGEST_GAP, 0), (0, 2), (3, 2)])
def test_steps_since_a_robot_was_seen_are_counted_from_the_state_that_was_seen(steps, age_steps):
    memory = unseen_for(steps, age_steps=age_steps)
    assert memory.unseen_steps("b") == steps + age_steps
    assert memory.unseen_steps("a") == 0


def test_caution_is_how_far_an_acceleration_takes_a_robot_while_nobody_sees_it_up_to_a_limit():
    assert unseen_for(4).caution_m("b") == pytest.approx(3.0 * 0.4**2 / 2.0)
    assert unseen_for(4, limits=Limits(acceleration_mps2=0.5)).caution_m("b") == pytest.approx(0.04)
    assert unseen_for(0).caution_m("b") == unseen_for(4).caution_m("a") == 0.0
    assert unseen_for(LONGEST_GAP).caution_m("b") == MOST_CAUTION_M < 3.0 * (LONGEST_GAP * STEP_S) ** 2 / 2.0
