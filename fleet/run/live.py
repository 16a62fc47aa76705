"""A run in real processes: a world, one process per robot, and the bench that listens to all of them."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from fleet.inject.process_faults import WORLD, ProcessFaults
from fleet.interruption import Interruption
from fleet.record.address import left_in
from fleet.record.stream import StreamItem
from fleet.run.experiment import Experiment
from fleet.run.launch import Launch
from fleet.run.listening import Subscriber
from fleet.run.processes import Processes
from fleet.run.progress import compile_solver
from fleet.run.supervisor import Restart, Supervisor


def run_processes(
    experiment: Experiment,
    log_directory: Path,
    interruption: Interruption,
    restart: Restart = Restart.NEVER,
) -> Iterator[StreamItem]:
    """Every message of the bus, from the scene to the truth with the verdict, and what else is to be told.

    An interruption makes the world end the run, with its verdict. However the iteration is left, all
    processes have ended after it.

    Args:
        experiment: what to run.
        log_directory: made here; each process writes its log into it.
        interruption: looked at while waiting.
        restart: which processes are started again when they end before the run is over.

    Raises:
        Refusal: the solver cannot be compiled; the world or, before the first step, a robot ended
            for good; or a robot did so later, which is told after the verdict of the others.
        KeyboardInterrupt: an interruption came before the world could give a verdict, or came twice.
    """
    compile_solver(interruption)
    log_directory.mkdir()
    with tempfile.TemporaryDirectory(prefix="unspoken-") as directory, Processes(log_directory) as processes:
        launch = Launch(experiment, Path(directory))
        processes.start(*launch.world())
        supervisor = Supervisor(processes, restart)
        faults = ProcessFaults(experiment.scenario, experiment.facts.seed, processes, supervisor)
        bench = Subscriber(experiment.facts.run, processes, supervisor, faults, interruption)
        with bench.connect(launch.bench()) as session, left_in(log_directory.parent, launch.address()):
            yield from bench.subscribe(session)
            for robot in experiment.scenario.robots:
                for settings in launch.of_robot(robot):
                    processes.start(*settings)
            yield from bench.listen()
        processes.wait(WORLD)  # which stays until the bench has left
