"""A run in virtual time as a stream of the messages that processes would have exchanged."""

import time
from collections.abc import Iterator

from agent.warm import warm_up
from fleet.closed_loop import closed_loop
from fleet.compiling import compile_solver
from fleet.experiment import Experiment
from fleet.interruption import Interruption
from fleet.stream import BusMessage
from protocol.keys import Keys
from protocol.messages import PublicScene


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
