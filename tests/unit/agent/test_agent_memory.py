"""What a robot remembers of what it saw: not always, late, with noise, and across ±π."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from agent_helpers import STEP_S, euler
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP, MOST_CAUTIOUS_STEPS, Memory, Track
from protocol.vehicle import STANDSTILL, Input, Limits, nearest_turn, wrap_angle

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


@given(st.floats(-math.pi, math.pi), st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=WINDOW - 1))
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


def unseen_for(steps: int, *, limits: Limits | None = None, age_steps: int = 0) -> Memory:
    """A robot that sees itself always, and b no more since step 3."""
    memory = Memory(17, STEP_S, owner="a", limits_of=lambda _: limits or Limits())
    for step in range(4 + steps):
        seen = {"a": moving(0)} | ({"b": moving(0)} if step < 4 else {})
        memory.remember(step, seen, age_steps=min(step, age_steps) if step < 4 else age_steps)
    return memory


@pytest.mark.parametrize(("steps", "age_steps"), [(0, 0), (LONGEST_GAP, 0), (0, 2), (3, 2), (LONGEST_GAP, 2)])
def test_steps_since_a_robot_was_seen_are_counted_from_the_state_that_was_seen(steps, age_steps):
    memory = unseen_for(steps, age_steps=age_steps)
    assert memory.unseen_steps("b") == steps + age_steps
    assert memory.unseen_steps("a") == 0


def test_caution_is_how_far_an_acceleration_takes_a_robot_while_nobody_sees_it_up_to_a_limit():
    assert unseen_for(4).caution_m("b") == pytest.approx(0.24)
    assert unseen_for(4, limits=Limits(acceleration_mps2=0.5)).caution_m("b") == pytest.approx(0.04)
    assert unseen_for(0).caution_m("b") == unseen_for(4).caution_m("a") == 0.0
    most_m = 3.0 * (MOST_CAUTIOUS_STEPS * STEP_S) ** 2 / 2.0
    for steps in (0, MOST_CAUTIOUS_STEPS, LONGEST_GAP):
        assert unseen_for(steps).most_caution_m("b") == pytest.approx(most_m)
    assert unseen_for(LONGEST_GAP).caution_m("b") == pytest.approx(most_m)


LOW = (0.02, 0.02, math.radians(2.0), 0.05)
RAMP = [(0.05 * k, 0.4 * k) for k in range(1, 8)]
INPUTS = [*RAMP, *[RAMP[-1]] * 5, *RAMP[::-1], *[(0.0, 0.0)] * 5, *[(-w, -a) for w, a in RAMP]]
"""Within the limits of rates, as robots drive: mostly at their limits."""
TRUE = euler((-3.0, 1.0, 3.0, 0.0), INPUTS)


def noisy(seed: int, sigmas: Any = LOW) -> np.ndarray:
    """The states of ``TRUE`` as measured, headings wrapped."""
    seen = TRUE + np.array(sigmas) * np.random.default_rng(seed).standard_normal(TRUE.shape)
    seen[:, 2] = [wrap_angle(heading) for heading in seen[:, 2]]
    return seen


def remembered(steps: int, seen: Any, *, owner: str | None = None, **how: Any) -> Memory:
    """A memory of one robot, ``a``, which is the owner if it knows its inputs."""
    memory = Memory(WINDOW, STEP_S, owner=owner)
    for step in range(steps):
        driven = Input(*INPUTS[step - 1]) if owner and step else None
        memory.remember(step, {"a": seen[step]}, driven=driven, **how)
    return memory


@settings(max_examples=20)
@given(st.integers(1, len(TRUE)), st.integers(0, 2**32))
def test_without_noise_states_are_what_was_seen_to_the_last_bit(steps, seed):
    seen = np.random.default_rng(seed).uniform(-3.0, 3.0, (steps, 4))
    for before, after in pairwise(seen):
        after[2] = nearest_turn(after[2], before[2])
    memory = remembered(steps, seen, owner="a", sigmas=(0.0, 0.0, 0.0, 0.0))
    assert memory.states("a", WINDOW).tolist() == seen[-WINDOW:].tolist()
    assert memory.is_exact("a")


def test_a_robot_that_knows_its_own_inputs_knows_its_speed_better():
    strange, own = (
        np.std([remembered(25, noisy(seed), owner=owner, sigmas=LOW).state("a")[3] for seed in range(10)])
        for owner in (None, "a")
    )
    assert own < 0.5 * strange


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_inputs_found_under_noise_are_within_the_limits(seed):
    seen = noisy(seed, sigmas=(0.1, 0.1, 0.5, 1.0))
    memory, limits = remembered(20, seen, sigmas=(0.1, 0.1, 0.5, 1.0)), Limits()
    found = memory.previous_input("a")
    assert abs(found.turn_rate_radps) <= limits.turn_rate_radps
    assert abs(found.acceleration_mps2) <= limits.acceleration_mps2
    assert np.all(np.abs(memory.states("a", WINDOW)[:, 3]) <= limits.speed_mps)


@pytest.mark.parametrize("delay", [1, 2, 5, LONGEST_GAP])
def test_a_steady_robot_seen_late_is_where_it_is_now(delay):
    steady = euler((0.0, 0.0, 1.0, 2.0), [(0.0, 0.0)] * 40)
    memory = Memory(WINDOW, STEP_S, owner="me")
    for step in range(30):
        age = min(step, delay)
        memory.remember(step, {"me": steady[0], "a": steady[step - age]}, age_steps=age)
        np.testing.assert_allclose(memory.state("a"), steady[step], atol=1e-12)
        assert memory.state("me").tolist() == steady[0].tolist()
    np.testing.assert_allclose(memory.states("a", WINDOW), steady[30 - WINDOW : 30], atol=1e-12)


def test_a_view_that_is_repeated_while_the_first_one_is_late_counts_once():
    memory = Memory(WINDOW, STEP_S, owner="me")
    for step in range(3):
        memory.remember(step, {"a": TRUE[0]}, sigmas=LOW, age_steps=step)
    once = Track(0, TRUE[0], np.array(LOW), Limits(), STEP_S)
    once.go_on(2, WINDOW)
    np.testing.assert_array_equal(memory.states("a", WINDOW), once.states)


def test_how_exactly_a_robot_is_known_is_told_by_when_it_was_last_seen():
    memory = Memory(WINDOW, STEP_S, owner="me")
    memory.remember(0, {"me": TRUE[0], "a": TRUE[0]})
    assert (memory.is_exact("a"), memory.sigma_m("a")) == (True, 0.0)
    for step, seen in ((1, {"me": TRUE[1], "a": TRUE[1]}), (2, {"me": TRUE[2]})):
        memory.remember(step, seen, sigmas=LOW)
        assert (memory.is_exact("a"), memory.sigma_m("a")) == (False, LOW[0])


def test_everybody_knows_that_robots_stand_at_first():
    seen = (*TRUE[0][:3], 0.4)
    first, later = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    first.remember(0, {"a": seen}, sigmas=LOW)
    later.remember(7, {"a": seen}, sigmas=LOW)
    assert first.state("a")[3] == pytest.approx(0.0, abs=1e-3)
    assert later.state("a")[3] == pytest.approx(0.4, abs=1e-3)
