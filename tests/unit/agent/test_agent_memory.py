"""What a robot remembers, with observations missing, late, repeated and crossing ±π."""

import math

import numpy as np
import pytest
from agent_helpers import STEP_S, euler
from hypothesis import given
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP, Memory
from protocol.arrival import wrap_angle
from protocol.vehicle import STANDSTILL

WINDOW = 17


def moving(step: int, *, speed: float = 2.0) -> tuple[float, float, float, float]:
    """Along x from the origin, as eq. 8 with a constant speed has it."""
    return (speed * STEP_S * step, 0.0, 0.0, speed)


def memory_of(steps: int, *robots: str) -> Memory:
    memory = Memory(WINDOW, STEP_S)
    for step in range(steps):
        assert memory.remember(step, dict.fromkeys(robots, moving(step)))
    return memory


def snapshot(memory: Memory) -> tuple[int, dict[str, list[list[float]]]]:
    return memory.step, {robot: memory.states(robot, 100).tolist() for robot in memory.robots}


@pytest.mark.parametrize("step", [4, 3, 0])
def test_repeated_and_old_steps_change_nothing(step):
    memory = memory_of(5, "a", "b")
    before = snapshot(memory)
    assert not memory.remember(step, {"a": (9.0, 9.0, 9.0, 9.0), "new": (1.0, 1.0, 1.0, 1.0)})
    assert snapshot(memory) == before


@given(st.permutations(range(12)))
def test_out_of_order_steps_leave_what_the_newer_ones_said(order):
    """Only those steps count that are newer than all before them."""
    shuffled, in_order = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    for place, step in enumerate(order):
        newest = step == max(order[: place + 1])
        assert shuffled.remember(step, {"a": moving(step)}) == newest
        if newest:
            in_order.remember(step, {"a": moving(step)})
    assert snapshot(shuffled) == snapshot(in_order)


def test_only_the_window_is_remembered():
    memory = memory_of(3 * WINDOW, "a")
    states = memory.states("a", 10 * WINDOW)
    assert states.tolist() == [list(moving(step)) for step in range(2 * WINDOW, 3 * WINDOW)]
    assert memory.states("a", 3).tolist() == states[-3:].tolist()
    assert memory.state("a").tolist() == states[-1].tolist()


def test_fewer_states_are_given_when_fewer_are_known():
    assert len(memory_of(3, "a").states("a", 10)) == 3


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


def test_an_unseen_robot_goes_on_at_its_speed_and_heading():
    memory = memory_of(5, "a", "b")
    for step in range(5, 8):
        memory.remember(step, {"a": moving(step)})
    np.testing.assert_allclose(memory.states("b", 4), [moving(step) for step in range(4, 8)])


@pytest.mark.parametrize("gap", [1, LONGEST_GAP])
def test_a_gap_is_filled_by_interpolation_once_the_robot_is_seen_again(gap):
    memory = memory_of(5, "a", "b")
    for step in range(5, 5 + gap):
        memory.remember(step, {"a": moving(step)})
    end = 5 + gap
    turned = (moving(end)[0], 3.0, -0.9, 1.0)
    memory.remember(end, {"a": moving(end), "b": turned})
    expected = [
        np.interp(np.arange(4, end + 1), [4, end], ends) for ends in zip(moving(4), turned, strict=True)
    ]
    np.testing.assert_allclose(memory.states("b", gap + 2), np.transpose(expected), atol=1e-12)
    assert len(memory.states("b", 100)) == min(WINDOW, end + 1)


def test_a_gap_is_filled_through_the_nearer_way_round():
    memory = Memory(WINDOW, STEP_S)
    memory.remember(0, {"a": (0.0, 0.0, 3.0, 0.0)})
    memory.remember(2, {"a": (0.0, 0.0, -3.0, 0.0)})
    assert memory.states("a", 3)[:, 2] == pytest.approx([3.0, math.pi, math.tau - 3.0])


@pytest.mark.parametrize("seen_every_step", [True, False])
@pytest.mark.parametrize(("gap", "is_remembered"), [(LONGEST_GAP, True), (LONGEST_GAP + 1, False)])
def test_a_robot_unseen_for_too_long_is_gone(seen_every_step, gap, is_remembered):
    """Whether observations without it came, or no observations at all."""
    memory = memory_of(5, "a", "b")
    for step in range(5, 5 + gap) if seen_every_step else [4 + gap]:
        memory.remember(step, {"a": moving(step)})
    assert memory.robots == (["a", "b"] if is_remembered else ["a"])


@pytest.mark.parametrize("absent_before", [0, LONGEST_GAP // 2, LONGEST_GAP])
@pytest.mark.parametrize("missed", [LONGEST_GAP + 1, 3 * LONGEST_GAP])
def test_a_robot_that_comes_back_after_too_long_begins_anew(absent_before, missed):
    """However the gap came about, nothing before it is mixed with what is seen now."""
    memory = memory_of(30, "a", "b")
    for step in range(30, 30 + absent_before):
        memory.remember(step, {"a": moving(step)})
    back = 30 + absent_before + missed
    memory.remember(back, {"a": moving(back), "b": (5.0, 5.0, 1.0, 0.5)})
    assert memory.states("b", 100).tolist() == [[5.0, 5.0, 1.0, 0.5]]
    assert memory.states("a", 100).tolist() == [list(moving(back))]
    assert memory.previous_input("b") == STANDSTILL


@given(st.lists(st.tuples(st.integers(1, 2 * LONGEST_GAP), st.booleans()), min_size=1, max_size=12))
def test_every_pattern_of_sightings_keeps_consecutive_states_that_agree_with_them(pattern):
    """A robot at a constant speed: guesses, interpolations and sightings are then all the same."""
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


def test_skipped_steps_are_filled_like_gaps():
    """An agent that was too slow for some observations still has one state a step."""
    inputs = [(0.1 * k, 0.5) for k in range(6)]
    states = euler((0.0, 0.0, 0.0, 1.0), inputs)
    memory = Memory(WINDOW, STEP_S)
    for step in (0, 1, 4, 5):
        memory.remember(step, {"a": states[step]})
    filled = memory.states("a", 100)
    assert len(filled) == 6
    np.testing.assert_allclose(filled[[0, 1, 4, 5]], states[[0, 1, 4, 5]])
    np.testing.assert_allclose(
        filled[2:4], [(2 * states[1] + states[4]) / 3, (states[1] + 2 * states[4]) / 3]
    )


def test_new_robots_join_at_any_step():
    memory = memory_of(5, "a")
    memory.remember(5, {"a": moving(5), "b": moving(0)})
    assert memory.robots == ["a", "b"]
    assert memory.states("b", 10).tolist() == [list(moving(0))]


def test_the_order_of_robots_does_not_depend_on_who_was_seen_first():
    one, other = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    for step, ids in enumerate((["c"], ["c", "a"], ["b", "c", "a"])):
        one.remember(step, dict.fromkeys(ids, moving(step)))
    other.remember(0, dict.fromkeys(["b", "a", "c"], moving(0)))
    assert one.robots == other.robots == ["a", "b", "c"]


def test_what_was_seen_is_copied():
    state = [1.0, 2.0, 3.0, 4.0]
    memory = Memory(WINDOW, STEP_S)
    memory.remember(0, {"a": state})
    state[0] = 99.0
    assert memory.state("a").tolist() == [1.0, 2.0, 3.0, 4.0]
