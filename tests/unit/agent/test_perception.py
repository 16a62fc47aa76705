"""What reaches a robot's memory of what it observes."""

import pytest
from agent_helpers import scene_of, seen

from agent.remember.perception import REACQUIRED_AFTER, Perception
from protocol.vehicle import Input

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


def test_an_observation_that_is_not_newer_changes_nothing_even_of_what_is_believed():
    perception = Perception(scene_of("ab"), "a")
    perception.take_in(seen(3, {"a": A, "b": B}), None)
    for step in (3, 1):
        assert perception.take_in(seen(step, {"a": A, "b": ELSEWHERE}), None) == set()
    assert perception.memory.state("b").tolist() == list(B)
    assert perception.take_in(seen(4, {"a": (0.2, *A[1:]), "b": B}), None) == set()
