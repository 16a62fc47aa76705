"""Arrival, and other robots that arrive, appear, vanish, or are not in the scene."""

import math

import numpy as np
import pytest
from agent_helpers import agent_of, euler, scene_of, seen

from agent.agent import Agent
from agent.remember.perception import REACQUIRED_AFTER
from protocol.messages import Accuracy, Mind
from protocol.scene import Goal

A = (-4.0, 0.0, 0.0, 1.0)
GOAL = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
NEAR = (3.97, 0.01, 0.02, 0.08)
"""Within the tolerance of 0.1: 0.03, 0.01, 0.02 and 0.08 have the norm 0.088."""
SAFETY_M = 1.39 - 1e-3
"""What plans keep: the real-time solver improves them a little at each step."""


def robot_a(goal: Goal = GOAL, *, shared=None, robots: str = "abc", **how) -> Agent:
    return agent_of(goal, scene_of(robots, goals=shared), **how)


def parked_path(mind: Mind, robot: str) -> bool:
    path = np.array(mind.prediction[robot])
    return bool((path == path[0]).all())


def believed(agent, step, states):
    """The decision once it believes what no vehicle could have done at once."""
    return [agent.decide(seen(step + again, states)) for again in range(REACQUIRED_AFTER)][-1]


def test_an_arrived_robot_brakes_to_a_standstill_and_holds():
    agent, state, previous = robot_a(), NEAR, (0.0, 0.0)
    for step in range(12):
        decision = agent.decide(seen(step, {"a": state}))
        assert decision.mind.arrived
        assert (decision.mind.estimates, decision.mind.prediction, decision.mind.plan) == ({}, {}, ())
        control = decision.command.input
        assert abs(control.acceleration_mps2 - previous[1]) <= 0.7 + 1e-9
        previous = control
        state = tuple(euler(state, [control])[1])
    assert state[3] == pytest.approx(0.0, abs=1e-9)
    assert previous == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("state", "goal_heading", "arrives"),
    [(NEAR, 0.0, True), (NEAR, -2 * math.tau, True), ((3.95, 0.01, 0.02, 0.09), 0.0, False)],
    ids=["within the tolerance", "a heading whole turns away", "just beyond"],
)
def test_it_has_arrived_within_the_tolerance_and_otherwise_drives_on(state, goal_heading, arrives):
    goal = Goal(x_m=4.0, y_m=0.0, heading_rad=goal_heading)
    mind = robot_a(goal).decide(seen(0, {"a": state})).mind
    assert mind.arrived == arrives
    assert bool(mind.plan) != arrives


def test_who_has_arrived_stays_arrived_even_when_pushed_away():
    agent = robot_a()
    assert agent.decide(seen(0, {"a": NEAR})).mind.arrived
    pushed = believed(agent, 1, {"a": (3.0, 0.5, 0.5, 0.0)})
    assert pushed.mind.arrived
    assert pushed.command.input == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("goals", ["constant-acceleration", "ioc", "exchanged"])
def test_a_robot_that_the_scene_does_not_name_is_kept_clear_of(goals):
    """It is taken for one of the largest known; and to stay, where only told goals are known."""
    agent = robot_a(goals=goals, shared={"a": GOAL} if goals == "exchanged" else None, robots="a")
    state = (-8.0, 0.0, 0.0, 0.0)
    for step in range(18):
        decision = agent.decide(seen(step, {"a": state, "stranger": (0.0, 0.2, math.pi, 0.0)}))
        mind = decision.mind
        assert mind.failed == ()
        assert set(mind.estimates) == set(mind.prediction) == {"a", "stranger"}
        gaps = np.linalg.norm(np.array(mind.plan) - mind.prediction["stranger"], axis=1)
        assert gaps[2:].min() > SAFETY_M
        state = tuple(euler(state, [decision.command.input])[1])


def test_where_goals_are_shared_arrived_robots_are_known_to_stay():
    """Also when their neighbourhood pushes them off their goal, and when a measurement says so."""
    shared = {"a": GOAL, "b": Goal(x_m=0.0, y_m=1.0, heading_rad=0.0)}
    agent = robot_a(goals="exchanged", shared=shared)
    on_the_way = agent.decide(seen(0, {"a": A, "b": (0.0, 0.0, 0.0, 0.0)})).mind
    assert not parked_path(on_the_way, "b")
    unshared = robot_a().decide(seen(0, {"a": A, "b": (0.0, 1.0, 0.0, 0.0)})).mind
    assert not parked_path(unshared, "b"), "who may be at its goal or not may go on"
    arrived = believed(agent, 1, {"a": A, "b": (0.0, 0.98, 0.01, 0.02)}).mind
    assert parked_path(arrived, "b")
    assert arrived.prediction["b"][0] == (0.0, 0.98)
    pushed = believed(agent, 4, {"a": A, "b": (0.0, 0.8, 0.0, 0.0)}).mind
    assert parked_path(pushed, "b")
    gaps = np.linalg.norm(np.array(pushed.plan) - (0.0, 0.8), axis=1)
    assert gaps.min() > SAFETY_M


def test_who_was_misled_into_believing_that_it_has_arrived_goes_on():
    """It is seen at its goal by chance, brakes, and is seen beside it from then on."""
    agent, accuracy = robot_a(goals="joint-fit"), Accuracy(position_m=0.02, heading_rad=0.035, speed_mps=0.05)
    state, arrived = (3.95, 0.0, 0.0, 0.0), []
    for step in range(30):
        decision = agent.decide(seen(step, {"a": state, "b": (7.0, 3.0, 0.0, 0.0)}, accuracy=accuracy))
        arrived.append(decision.mind.arrived)
        state = tuple(euler(state, [decision.command.input])[-1]) if step else (3.87, 0.0, 0.0, 0.0)
    assert arrived[0]
    assert not all(arrived)
    assert arrived[-1]
    assert math.dist(state[:2], (4.0, 0.0)) < 0.1
