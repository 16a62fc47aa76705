"""Arrival, and other robots that arrive, appear, vanish, or are not in the scene."""

import math

import numpy as np
import pytest
from agent_helpers import SOLVERS, STEP_S, euler, scene_of, seen

from agent.agent import Agent
from agent.remember.memory import LONGEST_GAP
from agent.remember.perception import REACQUIRED_AFTER
from protocol.messages import Mind
from protocol.scene import Goal

A = (-4.0, 0.0, 0.0, 1.0)
GOAL = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
NEAR = (3.97, 0.01, 0.02, 0.08)
"""Within the tolerance of 0.1: 0.03, 0.01, 0.02 and 0.08 have the norm 0.088."""
ON_THE_WAY_M = {"realtime": 1e-3, "reference": 1e-6}
"""How exactly plans keep distances: the real-time solver improves them a little at each step."""


def agent_of(
    goal: Goal = GOAL, *, goals="constant-acceleration", shared=None, robots: str = "abc", solver="realtime"
) -> Agent:
    scene = scene_of(robots, goals=shared)
    return Agent.of("a", goal, scene, goals=goals, solver=solver, clock=lambda: 0.0)


def parked_path(mind: Mind, robot: str) -> bool:
    path = np.array(mind.prediction[robot])
    return bool((path == path[0]).all())


def believed(agent, step, states):
    """The decision once it believes what no vehicle could have done at once."""
    return [agent.decide(seen(step + again, states)) for again in range(REACQUIRED_AFTER)][-1]


def test_an_arrived_robot_brakes_to_a_standstill_and_holds():
    agent, state, previous = agent_of(), NEAR, (0.0, 0.0)
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


def test_just_beyond_the_tolerance_it_goes_on_driving():
    decision = agent_of().decide(seen(0, {"a": (3.95, 0.01, 0.02, 0.09)}))
    assert not decision.mind.arrived
    assert decision.mind.plan


def test_who_has_arrived_stays_arrived_even_when_pushed_away():
    agent = agent_of()
    assert agent.decide(seen(0, {"a": NEAR})).mind.arrived
    pushed = believed(agent, 1, {"a": (3.0, 0.5, 0.5, 0.0)})
    assert pushed.mind.arrived
    assert pushed.command.input == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_goal_heading_a_whole_turn_away_is_the_same_heading():
    goal = Goal(x_m=4.0, y_m=0.0, heading_rad=-2 * math.tau)
    assert agent_of(goal).decide(seen(0, {"a": NEAR})).mind.arrived


@pytest.mark.parametrize("solver", SOLVERS)
def test_robots_appear_and_vanish_between_steps(solver):
    agent, away = agent_of(solver=solver), (0.0, -4.0, math.pi / 2, 1.0)
    others = [{}, {"b": away}, {"b": away, "c": (2.0, 3.0, 0.0, 0.0)}, {"c": (2.0, 3.0, 0.0, 0.0)}]
    state, present = A, []
    for step in range(4 + LONGEST_GAP):
        decision = agent.decide(seen(step, {"a": state} | others[min(step, 3)]))
        assert decision.mind.failed == ()
        assert set(decision.mind.estimates) == set(decision.mind.prediction)
        present.append("".join(decision.mind.prediction))
        state = tuple(euler(state, [decision.command.input])[1])
    assert present[:3] == ["a", "ab", "abc"]
    assert present[3:] == ["abc"] * LONGEST_GAP + ["ac"], "b was last seen at step 2"


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("goals", ["constant-acceleration", "ioc", "exchanged"])
def test_a_robot_that_the_scene_does_not_name_is_kept_clear_of(goals, solver):
    """It is taken for one of the largest known; and to stay, where only told goals are known."""
    agent = agent_of(
        goals=goals, shared={"a": GOAL} if goals == "exchanged" else None, robots="a", solver=solver
    )
    state = (-8.0, 0.0, 0.0, 0.0)
    for step in range(18):
        decision = agent.decide(seen(step, {"a": state, "stranger": (0.0, 0.2, math.pi, 0.0)}))
        mind = decision.mind
        assert mind.failed == ()
        assert set(mind.estimates) == set(mind.prediction) == {"a", "stranger"}
        gaps = np.linalg.norm(np.array(mind.plan) - mind.prediction["stranger"], axis=1)
        assert gaps[2:].min() > 1.39 - ON_THE_WAY_M[solver]
        state = tuple(euler(state, [decision.command.input])[1])


def test_where_goals_are_shared_arrived_robots_are_known_to_stay():
    """Also when their neighbourhood pushes them off their goal, and when a measurement says so."""
    shared = {"a": GOAL, "b": Goal(x_m=0.0, y_m=1.0, heading_rad=0.0)}
    agent = agent_of(goals="exchanged", shared=shared)
    on_the_way = agent.decide(seen(0, {"a": A, "b": (0.0, 0.0, 0.0, 0.0)})).mind
    assert not parked_path(on_the_way, "b")
    arrived = believed(agent, 1, {"a": A, "b": (0.0, 0.98, 0.01, 0.02)}).mind
    assert parked_path(arrived, "b")
    assert arrived.prediction["b"][0] == (0.0, 0.98)
    pushed = believed(agent, 4, {"a": A, "b": (0.0, 0.8, 0.0, 0.0)}).mind
    assert parked_path(pushed, "b")
    gaps = np.linalg.norm(np.array(pushed.plan) - (0.0, 0.8), axis=1)
    assert gaps.min() > 1.39 - ON_THE_WAY_M["realtime"]


def test_where_goals_are_not_shared_a_robot_at_its_goal_may_go_on():
    agent = agent_of()
    mind = agent.decide(seen(0, {"a": A, "b": (0.0, 1.0, 0.0, 0.0)})).mind
    assert not parked_path(mind, "b")


def test_a_robot_sent_elsewhere_than_the_scene_says_still_decides_at_the_scenes_goal():
    shared = {"a": Goal(x_m=-4.0, y_m=0.0, heading_rad=0.0)}
    agent = agent_of(GOAL, goals="exchanged", shared=shared)
    decision = agent.decide(seen(0, {"a": (-4.0, 0.0, 0.0, 0.0)}))
    assert not decision.mind.arrived
    assert decision.mind.failed == ()
    assert decision.command.input == pytest.approx((0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_robot_alone_reaches_its_goal_and_commands_only_what_it_can_reach(solver):
    """Step after step from its own poses: the plan's promises add up to an arrival."""
    agent, state, previous = agent_of(solver=solver), (1.0, -0.5, 0.3, 0.0), (0.0, 0.0)
    for step in range(80):
        decision = agent.decide(seen(step, {"a": state}))
        if decision.mind.arrived:
            break
        turn_rate, acceleration = decision.command.input
        assert abs(turn_rate - previous[0]) <= 0.5 * STEP_S + 1e-9
        assert abs(acceleration - previous[1]) <= 7.0 * STEP_S + 1e-9
        previous = (turn_rate, acceleration)
        state = tuple(euler(state, [previous])[1])
    assert decision.mind.arrived
    assert math.dist(state[:2], (4.0, 0.0)) < 0.1
