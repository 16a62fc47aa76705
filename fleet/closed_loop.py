"""A world and its robots in one process and virtual time, step by step."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from agent.agent import Agent, Decision
from agent.deadline import Deadline
from agent.stopwatch import Clock
from fleet.facts import RunFacts
from protocol.messages import Observation, Truth
from protocol.scenario import Scenario, ScenarioRobot
from protocol.scene import Scene
from world.world import World

EPOCH = 0
"""There is one world only, and what it says depends on nothing but the run."""


class Moment(NamedTuple):
    """One step: how things stand, what each robot sees of them, and what it decides."""

    truth: Truth
    observations: Mapping[str, Observation]
    decisions: Mapping[str, Decision]
    """Of the robots that made one; in the last moment nobody does."""


def closed_loop(
    scenario: Scenario, facts: RunFacts, clock: Clock, interrupted: Callable[[], bool] = lambda: False
) -> Iterator[Moment]:
    """Every step of a run; the last moment's truth holds the verdict.

    Args:
        scenario: what is driven.
        facts: with which estimator, solver and seed.
        clock: times the robots' decisions.
        interrupted: asked once a step; ends the run with the verdict ``interrupted``.

    Raises:
        ValueError: an estimator needs something that the scene does not hold.
    """
    world = World(scenario, seed=facts.seed, epoch=EPOCH)
    agents = _agents(scenario, facts, clock)
    while not world.over:
        observations = world.observations()
        decided = {robot: agents[robot].decide(seen) for robot, seen in observations.items()}
        decisions = {robot: decision for robot, decision in decided.items() if decision is not None}
        yield Moment(world.truth(), observations, decisions)
        if interrupted():
            world.interrupt()
        else:
            world.advance({robot: decision.command for robot, decision in decisions.items()})
    yield Moment(world.truth(), {}, {})


def _agents(scenario: Scenario, facts: RunFacts, clock: Clock) -> dict[str, Agent]:
    scene = scenario.scene(with_goals=facts.goals_are_exchanged)
    budget_s = None if facts.budget_ms is None else facts.budget_ms / 1000.0
    return {
        robot.id: agent_of(robot, scene, facts, clock, Deadline(clock, budget_s)) for robot in scenario.robots
    }


def agent_of(robot: ScenarioRobot, scene: Scene, facts: RunFacts, clock: Clock, deadline: Deadline) -> Agent:
    """A robot of a run, which has not seen anything yet.

    Raises:
        ValueError: its estimator needs something that the scene does not hold.
        ModuleNotFoundError: the library of a baseline is not installed here.
    """
    return Agent(
        robot.id,
        robot.goal_pose(),
        scene,
        goals=facts.goals,
        solver=facts.solver,
        clock=clock,
        iterations=facts.iterations,
        deadline=deadline,
    )
