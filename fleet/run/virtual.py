"""A run in virtual time as a stream of the messages that processes would have exchanged."""

import time
from collections.abc import Callable, Iterator

from agent.agent import Agent
from agent.process.warm import warm_up
from agent.solve.deadline import Clock, Deadline
from fleet.inject.disturbed_loop import disturbed_loop
from fleet.interruption import Interruption
from fleet.record.stream import BusMessage
from fleet.run.experiment import Experiment, RunFacts
from fleet.run.moment import EPOCH, Moment, agent_of
from fleet.run.progress import compile_solver
from protocol.keys import Keys
from protocol.messages import PublicScene
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


def simulate(experiment: Experiment, interruption: Interruption) -> Iterator[BusMessage]:
    """Every message that the processes would have exchanged in lock-step, in the same order of steps.

    Raises:
        ProcessFailedError: the solver cannot be compiled.
        KeyboardInterrupt: an interruption came while it was compiled.
        ValueError: an estimator needs something that the scene does not hold.
    """
    scenario, facts = experiment.scenario, experiment.facts
    compile_solver(interruption)
    warm_up(facts.goals, facts.solver)
    keys = Keys(facts.run)
    scene = scenario.scene(with_goals=facts.goals_are_exchanged)
    epoch, begun_ns, now_ns = None, 0, 0
    for moment in closed_loop(scenario, facts, time.perf_counter, lambda: interruption.requested):
        if moment.truth.epoch != epoch:
            epoch, begun_ns = moment.truth.epoch, now_ns
            yield BusMessage(keys.scene, PublicScene(epoch=epoch, scene=scene), begun_ns)
        now_ns = begun_ns + round(moment.truth.time_s * 1e9)
        for robot, observation in moment.observations.items():
            yield BusMessage(keys.pose(robot), observation, now_ns)
        yield BusMessage(keys.truth, moment.truth, now_ns)
        for robot, commands in moment.commands.items():
            if robot in moment.decisions:
                yield BusMessage(keys.mind(robot), moment.decisions[robot].mind, now_ns)
            for command in commands:
                yield BusMessage(keys.command(robot), command, now_ns)
