"""What an agent makes of noisy or late observations: of its own arrival, and of where others are."""

import math
from typing import Any

import numpy as np
from agent_helpers import agent_of, euler, scene_of, seen

from agent.agent import Agent, Decision
from protocol.messages import Accuracy
from protocol.scene import Goal

GOAL = Goal(x_m=0.0, y_m=0.0, heading_rad=0.0)
LOW = Accuracy(position_m=0.02, heading_rad=math.radians(2.0), speed_mps=0.05)
BESIDE = (-0.13, 0.0, 0.0, 0.0)
"""Not there, but not far from it either."""
PARKED = (3.0, 3.0, 0.0, 0.0)


def robot_a(goal: Goal = GOAL) -> Agent:
    return agent_of(goal, scene_of("ab"), goals="joint-fit")


def decided(agent: Agent, step: int, *states: Any, **how: Any) -> Decision:
    decision = agent.decide(seen(step, dict(zip("ab", states, strict=False)), **how))
    assert decision is not None
    return decision


def test_who_was_misled_into_believing_that_it_has_arrived_goes_on():
    """It is seen at its goal by chance, brakes, and is seen beside it from then on."""
    agent = robot_a()
    decision = decided(agent, 0, (-0.05, 0.0, 0.0, 0.0), PARKED, accuracy=LOW)
    assert decision.mind.arrived
    state, arrived = BESIDE, []
    for step in range(1, 30):
        decision = decided(agent, step, state, PARKED, accuracy=LOW)
        state = tuple(euler(state, [decision.command.input])[-1])
        arrived.append(decision.mind.arrived)
    assert not all(arrived)
    assert math.hypot(*state) < 0.1
    assert arrived[-1]


def test_the_commands_that_it_gave_tell_a_robot_where_it_is():
    """Of twenty noisy views each; nothing but its own commands tells its speed better."""
    random, errors = np.random.default_rng(0), []
    sigmas = np.array(LOW.as_tuple())
    for _ in range(4):
        agent, state = robot_a(goal=Goal(x_m=6.0, y_m=2.0, heading_rad=0.0)), (-4.0, 0.0, 0.0, 0.0)
        for step in range(20):
            view = np.array(state) + sigmas * random.standard_normal(4)
            decision = decided(agent, step, view, PARKED, accuracy=LOW)
            errors.append((np.array(decision.mind.plan[0]) - state[:2]) if step > 5 else np.zeros(2))
            state = tuple(euler(state, [decision.command.input])[-1])
    assert np.sqrt(np.mean(np.square(errors))) < 0.5 * LOW.position_m
