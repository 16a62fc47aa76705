"""A way out of a stop: who backs off, when, and that robots in one another's way both get through."""

import itertools
import math

import numpy as np
import pytest
from agent_helpers import remembered, scene_of

from agent.process.options import DecisionOptions
from agent.solve.vehicle import Array
from agent.solve.yielding import SURE_STEPS, TURN_STEPS, Yielding
from protocol.scenario import Pose, Scenario, ScenarioRobot
from world.world import World

GOAL = np.array([3.0, 0.0, 0.0, 0.0])
BESIDE_M = {"a": 0.0, "b": 1.3, "c": -1.3, "d": 20.0}


def backs_off(
    robot: str, robots: str, *, driving: str = "", held_up: bool = True, steps: int = 60
) -> tuple[int | None, Array]:
    """The step at which a robot begins to back off, and where to."""
    tracks = {}
    for each in robots:
        speed = 1.0 if each in driving else 0.0
        along = 0.1 * speed * np.arange(steps)
        still = np.zeros(steps)
        tracks[each] = np.column_stack([along, still + BESIDE_M[each], still + math.pi / 2, still + speed])
    yielding = Yielding(scene_of(robots), robot)
    for step in range(1, steps):
        memory = remembered(
            {each: track[: step + 1] for each, track in tracks.items()}, estimation_steps=step + 1
        )
        yielding.judge(memory, held_up)
        destination = yielding.destination(memory, GOAL)
        if destination is not GOAL:
            return step, destination
    return None, GOAL


def test_one_after_the_other_backs_off_straight_away_from_those_around():
    (first, refuge), (second, _), (third, _) = (backs_off(robot, "abcd") for robot in "abc")
    assert (first, second, third) == (SURE_STEPS, SURE_STEPS + TURN_STEPS, SURE_STEPS + 2 * TURN_STEPS)
    for step, (robot, beside) in zip((first, second), list(BESIDE_M.items())[:2], strict=True):
        _, refuge = backs_off(robot, "ab")
        assert step is not None
        other = BESIDE_M["b" if robot == "a" else "a"]
        assert abs(refuge[1] - other) == pytest.approx(abs(beside - other) + 2 * 1.39)
        assert refuge[2:].tolist() == [math.pi / 2, 0.0]


@pytest.mark.parametrize(
    "how", [{"driving": "b"}, {"driving": "a"}, {"held_up": False}, {"robots": "a"}, {"robots": "ad"}]
)
def test_nobody_backs_off_who_is_not_held_up_or_not_by_robots_that_stand(how):
    assert backs_off("a", **{"robots": "ab", **how})[0] is None


@pytest.mark.parametrize("headings", [(0.0, math.pi), (math.pi / 2, -math.pi / 2)])
def test_two_that_stand_where_the_other_wants_to_be_get_through(headings):
    """Each is thought to have arrived, and holds the other up: without backing off it is a deadlock."""
    places = {"a": (-0.695, headings[0]), "b": (0.695, headings[1])}
    robots = [
        ScenarioRobot(
            id=robot,
            start=Pose(x_m=x, y_m=0.0, heading_rad=heading),
            goal=Pose(x_m=-x - math.copysign(0.1, x), y_m=0.0, heading_rad=heading),
        )
        for robot, (x, heading) in places.items()
    ]
    scenario = Scenario(name="swap", robots=robots)
    world, scene = World(scenario, seed=0, epoch=0), scenario.scene(with_goals=False)
    agents = {
        robot.id: DecisionOptions().agent(robot.id, robot.goal_pose(), scene, lambda: 0.0) for robot in robots
    }
    for step in itertools.count():
        truth = world.truth()
        if truth.verdict is not None:
            break
        decisions = {robot: agents[robot].decide(seen) for robot, seen in world.observations().items()}
        world.advance({robot: decision.command for robot, decision in decisions.items() if decision})
        assert step < 400
    assert truth.verdict == "arrived"
    assert not truth.collisions
