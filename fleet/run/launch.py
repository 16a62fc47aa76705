"""The settings with which each process of a run is started."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from agent.process.options import RobotOptions
from fleet.inject.process_faults import WORLD, name_of
from fleet.inject.settings import FaultSettings
from fleet.record.address import Address
from fleet.run.experiment import Experiment
from protocol.identity import Login, new_passwords, write_password, write_users
from protocol.keys import BENCH_NAME
from protocol.scenario import ScenarioRobot
from protocol.session import SessionSettings, client_session


class Logins:
    """What each process gets at its start to prove who it is.

    Args:
        directory: for the files, which nobody else may look into; it outlives the run.
        robots: their ids.
        needed: whether anybody has to prove anything; without, there are no files and no settings.

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


class ProcessSettings(NamedTuple):
    """One process, as :meth:`fleet.run.processes.Processes.start` takes it."""

    name: str
    module: str
    settings: dict[str, str]


class Launch:
    """The processes of one run on this machine.

    Args:
        experiment: what is run.
        directory: for sockets and passwords, which nobody else may look into; it outlives the run.

    Raises:
        OSError: passwords cannot be written.
    """

    def __init__(self, experiment: Experiment, directory: Path) -> None:
        self._experiment = experiment
        self._directory = directory
        self._endpoint = f"unixsock-stream/{directory}/world.sock"
        scenario, seed = experiment.scenario, experiment.facts.seed
        self._faults = FaultSettings(experiment.path, scenario, seed, directory)
        robots = [robot.id for robot in scenario.robots]
        self._logins = Logins(directory, robots, needed=experiment.facts.policy)

    def bench(self) -> SessionSettings:
        """The session of the bench."""
        return client_session(self._endpoint, self._logins.bench)

    def address(self) -> Address:
        """How somebody else of this user's can listen, too."""
        run, password_file = self._experiment.facts.run, self._logins.bench_file
        return Address(endpoint=self._endpoint, run=run, password_file=password_file)

    def world(self) -> ProcessSettings:
        """The world, which begins when the bench listens."""
        facts = self._experiment.facts
        settings = {
            "scenario": str(self._faults.scenario),
            "listen": self._endpoint,
            "run": facts.run,
            "clock": facts.clock,
            "seed": str(facts.seed),
            "exchange_goals": "1" if facts.goals_are_exchanged else "0",
            "await_reader": "1",
        }
        return ProcessSettings(WORLD, "world", settings | self._logins.of_world())

    def of_robot(self, robot: ScenarioRobot) -> Iterator[ProcessSettings]:
        """A robot and, where a fault lies on its link, what stands between it and the world."""
        endpoint = self._endpoint
        if self._faults.on_link(robot.id):
            endpoint = f"unixsock-stream/{self._directory}/{robot.id}.sock"
            yield self._relay(robot.id, endpoint)
        yield self._robot(robot, endpoint)

    def _relay(self, robot: str, endpoint: str) -> ProcessSettings:
        settings = {
            "robot": robot,
            "connect": self._endpoint,
            "listen": endpoint,
            "run": self._experiment.facts.run,
            **self._faults.settings,
            **self._logins.of_relay(robot),
        }
        return ProcessSettings(f"relay-{robot}", "fleet.inject.relay", settings)

    def _robot(self, robot: ScenarioRobot, endpoint: str) -> ProcessSettings:
        """It gets its own goal and no other."""
        facts = self._experiment.facts
        options = RobotOptions(
            robot=robot.id, goal=robot.goal_pose(), connect=endpoint, run=facts.run, **facts.decisions()
        )
        settings = options.as_environment() | self._logins.of_robot(robot.id)
        if self._faults.on_robot(robot.id):
            return ProcessSettings(name_of(robot.id), "fleet.inject.robot", settings | self._faults.settings)
        return ProcessSettings(name_of(robot.id), "agent", settings)
