"""A robot that is late knows what was driven in its place: World and Agent, core against core."""

import random
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from agent_helpers import EPOCH, NEVER, euler, scene_of, seen
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agent.agent import Agent
from agent.drive.commands import DOUBTFUL
from agent.estimate.goals import Unestimated
from agent.methods import Method
from agent.solve.planning import Plan
from protocol.scenario import Pose, Scenario, ScenarioRobot
from protocol.scene import Goal, Scene
from protocol.vehicle import Input
from world.world import World

FAR_GOAL = Goal(x_m=9.0, y_m=0.0, heading_rad=0.0)
MOVING = (-4.0, 0.0, 0.0, 1.0)


@dataclass
class Whims:
    """Stands for prediction and planning: plans by chance, without regard for limits, and fails at times."""

    random: random.Random
    previous: list[Input] = field(default_factory=list)
    """What the agent took to have been driven before, at each of its plans."""

    def predict(self, *_: Any) -> Any:
        return SimpleNamespace(solved=True, paths={})

    def plan(self, memory: Any, goal: Any, previous: Input, prediction: Any, room: Any) -> Plan:
        self.previous.append(previous)
        inputs = [[self.random.uniform(-2, 2), self.random.uniform(-4, 4)] for _ in range(2)]
        return Plan(np.array(inputs), np.zeros((3, 4)), solved=self.random.random() < 0.8)


def agent_with(whims: Any, scene: Scene) -> Agent:
    return Agent("a", FAR_GOAL, scene, Method(Unestimated(), whims, whims, NEVER), lambda: 0.0)


COURSES = [
    st.lists(st.sampled_from(["in time", "late", missing]), max_size=40)
    # Not both: a robot that sleeps may not see the step that would show that it was late.
    for missing in ("asleep", "unknowingly late")
]


def is_told_in_time(course: list[str]) -> bool:
    """By chance, planned and driven inputs are often alike, which hides lateness, but not for long."""
    hidden = 0
    for what in course:
        hidden = {"in time": 0, "unknowingly late": hidden + 1}.get(what, hidden)
        if hidden > DOUBTFUL:
            return False
    return True


@settings(max_examples=50)
@given(st.one_of(COURSES).filter(is_told_in_time), st.integers(0, 2**32))
@example(["in time", "asleep", "late", "asleep", "asleep", "late"], 339930498).via("seems to stand, asleep")
def test_it_knows_what_the_world_drove_however_often_it_was_late_or_asleep(course, seed):
    robot = ScenarioRobot(id="a", start=Pose(x_m=-9.0, y_m=0.0), goal=Pose(x_m=9.0, y_m=0.0))
    scenario = Scenario(name="alone", robots=[robot])
    world, whims = World(scenario, seed=0, epoch=EPOCH), Whims(random.Random(seed))
    agent = agent_with(whims, scenario.scene(with_goals=False))
    driven = []
    for what in course:
        commands = {}
        if what != "asleep":
            true = world.truth().robots["a"]
            driven.append((true.turn_rate_radps, true.acceleration_mps2))
            decision = agent.decide(world.observations()["a"])
            assert decision is not None
            if what == "in time":
                commands["a"] = decision.command
            elif what == "late":
                agent.withdraw()
        world.advance(commands)
    np.testing.assert_allclose(whims.previous, driven, atol=1e-9)
    assert world.truth().robots["a"].clipped_commands == 0


def test_until_it_has_given_a_command_the_last_input_is_recovered_from_the_poses():
    """As when its process was started anew in the middle of a run."""
    whims = Whims(random.Random(0))
    agent = agent_with(whims, scene_of("a"))
    agent.decide(seen(7, {"a": MOVING}))
    agent.withdraw()
    agent.decide(seen(8, {"a": euler(MOVING, [(0.1, 0.5)])[-1]}))
    assert whims.previous[0] == (0.0, 0.0)
    assert whims.previous[1] == pytest.approx((0.1, 0.5))
