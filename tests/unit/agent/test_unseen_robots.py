"""What a memory says about robots that it does not see, and how far plans keep away from them."""

import numpy as np
import pytest
from agent_helpers import STEP_S, scene_of

from agent.remember.memory import LONGEST_GAP, MOST_CAUTION_M, Memory
from agent.solve.problem import joint_problem
from protocol.vehicle import STANDSTILL, Limits

ALONG_X = (0.0, 0.0, 0.0, 1.0)
SLUGGISH = Limits(acceleration_mps2=0.5)


def unseen_for(steps: int, *, limits: Limits | None = None, age_steps: int = 0) -> Memory:
    """A robot that sees itself always, and b no more since step 3."""
    memory = Memory(17, STEP_S, owner="a", limits_of=lambda _: limits or Limits())
    for step in range(4):
        memory.remember(step, {"a": ALONG_X, "b": ALONG_X}, age_steps=min(step, age_steps))
    for step in range(4, 4 + steps):
        memory.remember(step, {"a": ALONG_X}, age_steps=age_steps)
    return memory


@pytest.mark.parametrize(("steps", "age_steps"), [(0, 0), (1, 0), (LONGEST_GAP, 0), (0, 2), (3, 2)])
def test_steps_since_a_robot_was_seen_are_counted_from_the_state_that_was_seen(steps, age_steps):
    memory = unseen_for(steps, age_steps=age_steps)
    assert memory.unseen_steps("b") == steps + age_steps
    assert memory.unseen_steps("a") == 0


def test_caution_is_how_far_an_acceleration_takes_a_robot_while_nobody_sees_it():
    assert unseen_for(0).caution_m("b") == 0.0
    assert unseen_for(4).caution_m("b") == pytest.approx(3.0 * 0.4**2 / 2.0)
    assert unseen_for(4, limits=SLUGGISH).caution_m("b") == pytest.approx(0.5 * 0.4**2 / 2.0)
    assert unseen_for(4).caution_m("a") == 0.0


def test_caution_has_a_limit():
    cautions_m = [unseen_for(steps).caution_m("b") for steps in range(LONGEST_GAP + 1)]
    assert cautions_m == sorted(cautions_m)
    assert cautions_m[-1] == MOST_CAUTION_M < 3.0 * (LONGEST_GAP * STEP_S) ** 2 / 2.0


def test_a_robot_that_is_forgotten_begins_anew():
    memory = unseen_for(2)
    memory.forget("b")
    assert memory.robots == ["a"]
    memory.remember(6, {"a": ALONG_X, "b": (5.0, 5.0, 1.0, 2.0)})
    assert memory.states("b", 9).tolist() == [[5.0, 5.0, 1.0, 2.0]]
    assert memory.previous_input("b") == STANDSTILL
    assert memory.unseen_steps("b") == 0


def test_nobody_needs_to_be_known_to_be_forgotten():
    memory = unseen_for(0)
    memory.forget("stranger")
    assert memory.robots == ["a", "b"]


def test_a_problem_keeps_its_caution_from_those_who_move_as_told_and_from_nobody_else():
    scene = scene_of("abcd")
    steps = scene.horizons.prediction_steps
    state, path = np.array(ALONG_X), np.zeros((steps + 1, 2))
    problem = joint_problem(
        scene,
        dict.fromkeys("ab", state),
        dict.fromkeys("ab", state),
        dict.fromkeys("cd", path),
        dict.fromkeys("ab", STANDSTILL),
        {"d": 0.3, "b": 0.4},
    )
    safe_m = scene.safety_distance_m("a", "b")
    np.testing.assert_allclose(problem.safety_distances, [[safe_m, safe_m, safe_m, safe_m + 0.3]] * 2)
