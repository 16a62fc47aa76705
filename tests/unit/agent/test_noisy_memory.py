"""What a robot remembers of what it saw late, or with noise."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from agent_helpers import STEP_S, euler
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.remember.memory import LONGEST_GAP, Memory, Track
from protocol.vehicle import Input, Limits, nearest_turn, wrap_angle

WINDOW = 17
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


def off(states: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Errors of states, headings in any turn."""
    error = states - true
    error[..., 2] = (error[..., 2] + math.pi) % math.tau - math.pi
    return np.array(error)


def root_mean_square(errors: list[np.ndarray]) -> Any:
    return np.sqrt(np.mean(np.square(errors), axis=0))


@settings(max_examples=20)
@given(st.integers(1, len(TRUE)), st.integers(0, 2**32))
def test_without_noise_states_are_what_was_seen_to_the_last_bit(steps, seed):
    seen = np.random.default_rng(seed).uniform(-3.0, 3.0, (steps, 4))
    for before, after in pairwise(seen):
        after[2] = nearest_turn(after[2], before[2])
    memory = remembered(steps, seen, owner="a", sigmas=(0.0, 0.0, 0.0, 0.0))
    assert memory.states("a", WINDOW).tolist() == seen[-WINDOW:].tolist()
    assert memory.is_exact("a")


def test_a_robot_that_knows_its_own_inputs_knows_better_where_it_is():
    strange, own = [], []
    for seed in range(10):
        seen = noisy(seed)
        for errors, owner in ((strange, None), (own, "a")):
            errors.append(off(remembered(25, seen, owner=owner, sigmas=LOW).state("a"), TRUE[24]))
    assert np.all(root_mean_square(own) < [0.95, 0.95, 0.5, 0.5] * root_mean_square(strange))


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


def test_a_robot_out_of_view_is_kept_as_long_although_all_views_are_late():
    for delay in (0, 3):
        memory = Memory(WINDOW, STEP_S, owner="me")
        for step in range(5 + LONGEST_GAP + delay):
            age = min(step, delay)
            seen = {"a": TRUE[0]} if step - age < 5 else {}
            memory.remember(step, {"me": TRUE[0], **seen}, age_steps=age)
        assert memory.robots == ["a", "me"]
        memory.remember(memory.step + 1, {"me": TRUE[0]}, age_steps=delay)
        assert memory.robots == ["me"]


def test_a_state_is_certain_if_it_was_seen_now_and_without_noise():
    memory = Memory(WINDOW, STEP_S, owner="me")
    memory.remember(0, {"me": TRUE[0], "a": TRUE[0]})
    assert memory.is_certain("a")
    memory.remember(1, {"me": TRUE[0]})
    assert (memory.is_certain("me"), memory.is_certain("a")) == (True, False)
    memory.remember(2, {"me": TRUE[0], "a": TRUE[1]}, age_steps=1)
    assert (memory.is_certain("me"), memory.is_certain("a")) == (True, False)
    memory.remember(3, {"me": TRUE[0], "a": TRUE[3]}, sigmas=LOW)
    assert not memory.is_certain("a")


def test_everybody_knows_that_robots_stand_at_first():
    seen = (*TRUE[0][:3], 0.4)
    first, later = Memory(WINDOW, STEP_S), Memory(WINDOW, STEP_S)
    first.remember(0, {"a": seen}, sigmas=LOW)
    later.remember(7, {"a": seen}, sigmas=LOW)
    assert first.state("a")[3] == pytest.approx(0.0, abs=1e-3)
    assert later.state("a")[3] == pytest.approx(0.4, abs=1e-3)
