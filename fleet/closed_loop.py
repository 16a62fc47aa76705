"""A world and its robots in one process and virtual time, step by step."""

from collections.abc import Callable, Iterator

from agent.agent import Agent
from agent.deadline import Deadline
from agent.stopwatch import Clock
from fleet.facts import RunFacts
from fleet.faults.disturbed_loop import disturbed_loop
from fleet.moment import EPOCH, Moment, agent_of
from protocol.scenario import Scenario
from world.world import World


def closed_loop(
    scenario: Scenario, facts: RunFacts, clock: Clock, interrupted: Callable[[], bool] = lambda: False
) -> Iterator[Moment]:
    """Every step of a run; the last moment's truth holds the verdict.

    Args:
        scenario: what is driven, with the faults that are to befall it.
        facts: with which estimator, solver and seed.
        clock: times the robots' decisions.
        interrupted: asked once a step; ends the run with the verdict ``interrupted``.

    Raises:
        ValueError: an estimator needs something that the scene does not hold.
    """
    loop = disturbed_loop if scenario.faults else _undisturbed_loop
    return loop(scenario, facts, clock, interrupted)


def _undisturbed_loop(
    scenario: Scenario, facts: RunFacts, clock: Clock, interrupted: Callable[[], bool]
) -> Iterator[Moment]:
    """Without faults, whatever is said reaches whom it is for, and as it was said."""
    world = World(scenario, seed=facts.seed, epoch=EPOCH)
    agents = _agents(scenario, facts, clock)
    while not world.over:
        observations = world.observations()
        decided = {robot: agents[robot].decide(seen) for robot, seen in observations.items()}
        decisions = {robot: decision for robot, decision in decided.items() if decision is not None}
        commands = {robot: decision.command for robot, decision in decisions.items()}
        said = {robot: (command,) for robot, command in commands.items()}
        yield Moment(world.truth(), observations, decisions, said)
        if interrupted():
            world.interrupt()
        else:
            world.advance(commands)
    yield Moment(world.truth(), {}, {}, {})


def _agents(scenario: Scenario, facts: RunFacts, clock: Clock) -> dict[str, Agent]:
    scene = scenario.scene(with_goals=facts.goals_are_exchanged)
    return {
        robot.id: agent_of(robot, scene, facts, clock, Deadline(clock, facts.budget_s))
        for robot in scenario.robots
    }
