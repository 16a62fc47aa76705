"""What each process of a run is told at its start."""

from pathlib import Path
from typing import NamedTuple

from fleet.experiment import Experiment
from fleet.logins import Logins, NoLogins
from fleet.supervision import WORLD
from protocol.scenario import ScenarioRobot
from protocol.session import SessionSettings, client_session


class Role(NamedTuple):
    """One process, as :meth:`fleet.crew.Crew.start` wants it."""

    name: str
    module: str
    settings: dict[str, str]


def name_of(robot: str) -> str:
    """The process of a robot."""
    return f"robot-{robot}"


class Roles:
    """The processes of one run on this machine.

    Args:
        experiment: what is run.
        directory: for sockets and passwords, which nobody else may look into; it outlives the run.

    Raises:
        OSError: passwords cannot be written.
    """

    def __init__(self, experiment: Experiment, directory: Path) -> None:
        self._experiment = experiment
        self._endpoint = f"unixsock-stream/{directory}/world.sock"
        robots = [robot.id for robot in experiment.scenario.robots]
        self._logins = Logins(directory, robots) if experiment.facts.policy else NoLogins()

    def bench(self) -> SessionSettings:
        """The session of the bench."""
        return client_session(self._endpoint, self._logins.bench)

    def world(self) -> Role:
        """The world, which begins when the bench listens."""
        facts = self._experiment.facts
        settings = {
            "scenario": str(self._experiment.path),
            "listen": self._endpoint,
            "run": facts.run,
            "clock": facts.clock,
            "seed": str(facts.seed),
            "exchange_goals": "1" if facts.goals_are_exchanged else "0",
            "await_reader": "1",
        }
        return Role(WORLD, "world", settings | self._logins.of_world())

    def robot(self, robot: ScenarioRobot) -> Role:
        """A robot, which is told its own goal."""
        facts, goal = self._experiment.facts, robot.goal_pose()
        budget = {} if facts.budget_ms is None else {"budget_ms": repr(facts.budget_ms)}
        settings = budget | {
            "robot": robot.id,
            "goal": f"{goal.x_m!r},{goal.y_m!r},{goal.heading_rad!r}",
            "connect": self._endpoint,
            "run": facts.run,
            "goals": facts.goals,
            "solver": facts.solver,
            "iterations": str(facts.iterations),
        }
        return Role(name_of(robot.id), "agent", settings | self._logins.of_robot(robot.id))
