"""A run in virtual time: the cores of the world and of all robots in one process, step by step."""

import time
from collections.abc import Iterator

from agent.agent import Agent
from agent.warm import warm_up
from fleet.compiling import compile_solver
from fleet.experiment import Experiment
from fleet.interruption import Interruption
from fleet.stream import BusMessage
from protocol.keys import Keys
from protocol.messages import PublicScene
from world.world import World

EPOCH = 0
"""There is one world only, and its recording depends on nothing but the experiment."""


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
    scene = scenario.scene(with_goals=experiment.goals_are_exchanged)
    world = World(scenario, seed=facts.seed, epoch=EPOCH)
    agents = {
        robot.id: Agent(
            robot.id,
            robot.goal_pose(),
            scene,
            goals=facts.goals,
            solver=facts.solver,
            clock=time.perf_counter,
            iterations=facts.iterations,
            budget_s=None if facts.budget_ms is None else facts.budget_ms / 1000.0,
        )
        for robot in scenario.robots
    }
    yield BusMessage(keys.scene, PublicScene(epoch=EPOCH, scene=scene), 0)
    while not world.over:
        now_ns = round(scenario.time_s(world.step) * 1e9)
        observations = world.observations()
        for robot, observation in observations.items():
            yield BusMessage(keys.pose(robot), observation, now_ns)
        yield BusMessage(keys.truth, world.truth(), now_ns)
        commands = {}
        for robot, agent in agents.items():
            decision = agent.decide(observations[robot])
            if decision is not None:
                yield BusMessage(keys.mind(robot), decision.mind, now_ns)
                yield BusMessage(keys.command(robot), decision.command, now_ns)
                commands[robot] = decision.command
        if interruption.requested:
            world.interrupt()
        else:
            world.advance(commands)
    yield BusMessage(keys.truth, world.truth(), round(scenario.time_s(world.step) * 1e9))
