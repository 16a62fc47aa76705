"""A run in real processes: how each is started, where the run can be listened to, and its course."""

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import structlog

from agent.process.options import RobotOptions
from chassis.files import Record, write_private
from fleet.inject.process_faults import WORLD, ProcessFaults, name_of
from fleet.inject.scenario import FaultSettings
from fleet.interruption import Interruption, compile_solver
from fleet.record.experiment import Experiment
from fleet.record.recording import StreamItem
from fleet.run.listening import Subscriber
from fleet.run.processes import Processes, Restart, Supervisor
from protocol.identity import Login, new_passwords, write_password, write_users
from protocol.keys import BENCH_NAME, Name
from protocol.session import SessionSettings, client_session

FILE = ".reach.json"
"""Holds the address of a run that is going on, beside the run's output and for its owner alone."""

log = structlog.get_logger("bench")


class Address(Record):
    """What it takes to listen to a run as its bench does."""

    endpoint: str
    run: Name
    """Its name on the bus."""
    password_file: Path | None
    """With the bench's password; None for a run without a policy."""


@contextmanager
def left_in(directory: Path, address: Address) -> Iterator[None]:
    """Leave it in a run's directory for as long as the block lasts; a run goes on without it, too."""
    path = directory / FILE
    try:
        path.unlink(missing_ok=True)
        write_private(path, address.model_dump_json())
    except OSError as error:
        log.warning("this run cannot be looked at by its directory", path=str(path), reason=error.strerror)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


class Logins:
    """What each process gets at its start to prove who it is.

    Args:
        directory: for the files, which nobody else may look into; it outlives the run.
        robots: their ids.
        needed: whether anybody has to prove anything; otherwise there are no files and no settings.

    Raises:
        OSError: the files cannot be written.
    """

    def __init__(self, directory: Path, robots: Iterable[str], *, needed: bool = True) -> None:
        self._directory = directory
        self._passwords = new_passwords([BENCH_NAME, *robots]) if needed else {}
        if needed:
            write_users(directory / "users", self._passwords)
        for name, password in self._passwords.items():
            write_password(self._file(name), password)

    @property
    def bench(self) -> Login | None:
        """That of the bench."""
        return Login(BENCH_NAME, self._passwords[BENCH_NAME]) if self._passwords else None

    @property
    def bench_file(self) -> Path | None:
        """The file with the bench's password."""
        return self._file(BENCH_NAME) if self._passwords else None

    def of_world(self) -> dict[str, str]:
        """Settings of the world's process."""
        return {"users": str(self._directory / "users")} if self._passwords else {}

    def of_robot(self, robot: str) -> dict[str, str]:
        """Settings of a robot's process."""
        return {"password_file": str(self._file(robot))} if self._passwords else {}

    def of_relay(self, robot: str) -> dict[str, str]:
        """Settings of a process that stands for a robot at the world, and for the world at the robot.

        Raises:
            OSError: its file of users cannot be written.
        """
        if not self._passwords:
            return {}
        users = self._directory / f"{robot}.users"
        write_users(users, {robot: self._passwords[robot]})
        return {"users": str(users), **self.of_robot(robot)}

    def _file(self, name: str) -> Path:
        return self._directory / f"{name}.password"


class Launch:
    """Starts the processes of one run on this machine.

    Sockets and passwords are in a directory that outlives the run, and that nobody else may look into.

    Raises:
        OSError: passwords cannot be written.
    """

    def __init__(self, experiment: Experiment, directory: Path, processes: Processes) -> None:
        self._directory, self._processes = directory, processes
        self._facts, self._robots = experiment.facts, experiment.scenario.robots
        seed, policy = self._facts.seed, self._facts.policy
        self._faults = FaultSettings(experiment.path, experiment.scenario, seed, directory)
        self._logins = Logins(directory, [robot.id for robot in self._robots], needed=policy)
        endpoint = f"unixsock-stream/{directory}/world.sock"
        self.address = Address(endpoint=endpoint, run=self._facts.run, password_file=self._logins.bench_file)

    def bench(self) -> SessionSettings:
        """The session of the bench."""
        return client_session(self.address.endpoint, self._logins.bench)

    def start_world(self) -> None:
        """Start the world, which begins when the bench listens."""
        settings = {
            "scenario": str(self._faults.scenario),
            "listen": self.address.endpoint,
            "run": self._facts.run,
            "clock": self._facts.clock,
            "seed": str(self._facts.seed),
            "exchange_goals": "1" if self._facts.goals_are_exchanged else "0",
            "await_reader": "1",
        }
        self._processes.start(WORLD, "world", settings | self._logins.of_world())

    def start_robots(self) -> None:
        """Start all robots, each with its own goal only; before it a relay, where a fault is on its link."""
        for robot in self._robots:
            endpoint, run = self.address.endpoint, self._facts.run
            if self._faults.on_link(robot.id):
                endpoint = f"unixsock-stream/{self._directory}/{robot.id}.sock"
                ends = {"robot": robot.id, "connect": self.address.endpoint, "listen": endpoint, "run": run}
                settings = ends | self._faults.settings | self._logins.of_relay(robot.id)
                self._processes.start(f"relay-{robot.id}", "fleet.inject.relay", settings)
            options = RobotOptions(
                robot=robot.id, goal=robot.goal_pose(), connect=endpoint, run=run, **self._facts.decisions()
            )
            module, settings = "agent", options.as_environment() | self._logins.of_robot(robot.id)
            if self._faults.on_robot(robot.id):
                module, settings = "fleet.inject.robot", settings | self._faults.settings
            self._processes.start(name_of(robot.id), module, settings)


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
        Refusal: the solver cannot be compiled; or see :meth:`fleet.run.listening.Subscriber.listen`.
        KeyboardInterrupt: an interruption came before the world could give a verdict, or came twice.
    """
    compile_solver(interruption)
    log_directory.mkdir()
    with tempfile.TemporaryDirectory(prefix="unspoken-") as directory, Processes(log_directory) as processes:
        launch = Launch(experiment, Path(directory), processes)
        launch.start_world()
        supervisor = Supervisor(processes, restart)
        faults = ProcessFaults(experiment.scenario, experiment.facts.seed, processes, supervisor)
        bench = Subscriber(experiment.facts.run, processes, supervisor, faults, interruption)
        with bench.connect(launch.bench()) as session, left_in(log_directory.parent, launch.address):
            yield from bench.subscribe(session)
            launch.start_robots()
            yield from bench.listen()
        processes.wait(WORLD)  # which stays until the bench has left
