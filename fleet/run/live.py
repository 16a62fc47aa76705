"""A run in real processes: a world, one process per robot, and the bench that listens to all of them."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from fleet.inject.director import Director
from fleet.interruption import Interruption
from fleet.record.address import left_in
from fleet.record.stream import StreamItem
from fleet.run.compiling import compile_solver
from fleet.run.crew import Crew
from fleet.run.experiment import Experiment
from fleet.run.listening import Bench
from fleet.run.roles import Roles
from fleet.run.supervision import WORLD, Restart, Supervisor


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
        ProcessFailedError: the solver cannot be compiled; the world or, before the first step, a robot ended
            for good; or a robot did so later, which is told after the verdict of the others.
        KeyboardInterrupt: an interruption came before the world could give a verdict, or came twice.
    """
    compile_solver(interruption)
    log_directory.mkdir()
    with tempfile.TemporaryDirectory(prefix="unspoken-") as directory, Crew(log_directory) as crew:
        roles = Roles(experiment, Path(directory))
        crew.start(*roles.world())
        supervisor = Supervisor(crew, restart)
        director = Director(experiment, crew, supervisor)
        bench = Bench(experiment.facts.run, crew, supervisor, director, interruption)
        with bench.connect(roles.bench()) as session, left_in(log_directory.parent, roles.address()):
            yield from bench.subscribe(session)
            for robot in experiment.scenario.robots:
                for role in roles.of_robot(robot):
                    crew.start(*role)
            yield from bench.listen()
        crew.wait(WORLD)  # which stays until the bench has left
