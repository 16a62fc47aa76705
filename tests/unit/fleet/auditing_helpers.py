"""Recorded runs of two short-sighted robots that meet, made in this process, and their audits."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from agent.agent import Agent
from agent.process.options import DecisionOptions
from agent.solve.deadline import Deadline
from fleet.audit.audit import Audit, Report
from fleet.audit.recorded import RecordedRun, open_run
from fleet.interruption import Interruption
from fleet.record.recording import Recorder
from fleet.record.stream import BusMessage
from fleet.run.experiment import Experiment, prepare
from fleet.run.virtual import EPOCH, agent_of, simulate
from protocol.keys import Keys
from protocol.messages import Command, Message, PublicScene
from protocol.scenario import ScenarioRobot
from world.world import World

STEPS = 12
MEETING = [
    {"id": 1, "start": {"x_m": -1.2, "y_m": 0.0}, "goal": {"x_m": 1.2, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 1.2, "y_m": 0.1}, "goal": {"x_m": -1.2, "y_m": 0.0}},
]
DIM = {"position_noise_m": 0.01, "heading_noise_rad": 0.01, "dropout": 0.2, "delay_steps": 1}
"""Noise, dropouts and delay."""


def experiment_of(
    folder: Path, goals: Any = "joint-fit", *, budget_ms: float | None = None, **rules: Any
) -> Experiment:
    content = {
        "name": "meeting",
        "horizons": {"prediction_steps": 5, "estimation_steps": 3},
        "time_limit_s": 0.1 * STEPS,
        "robots": MEETING,
        **rules,
    }
    path = folder / "meeting.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return prepare(str(path), DecisionOptions(goals=goals, budget_ms=budget_ms), clock="virtual", seed=3)


def write(path: Path, experiment: Experiment, messages: Iterable[BusMessage]) -> Path:
    with Recorder(path, experiment.facts, experiment.path.read_text(encoding="utf-8")) as recorder:
        for message in messages:
            recorder.record(*message)
    return path


def simulated(experiment: Experiment) -> list[BusMessage]:
    return list(simulate(experiment, Interruption()))


def audited(path: Path) -> Report:
    audit = Audit(open_run(path))
    audit.go(lambda *_: None)
    return audit.report()


def opened(folder: Path, experiment: Experiment, messages: Iterable[BusMessage]) -> RecordedRun:
    return open_run(write(folder / "run.mcap", experiment, messages))


class RealTime:
    """A run in which robots may be late, though nothing takes any time.

    Args:
        experiment: what is run.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._facts, self._scenario = experiment.facts, experiment.scenario
        self._keys = Keys(self._facts.run)
        self._scene = self._scenario.scene(with_goals=self._facts.goals_are_exchanged)
        self._world = World(self._scenario, seed=self._facts.seed, epoch=EPOCH)
        self._agents = {robot.id: self._start(robot) for robot in self._scenario.robots}

    def said(self, course: Iterable[Mapping[str, str]]) -> Iterator[tuple[str, Message]]:
        """All messages, until it is interrupted.

        Args:
            course: by step, what a robot does: decides ``in time``; ``withdraws`` its command; is ``too
                late`` with a command on its way; is ``asleep``; or is ``restarted`` and then decides in time.
        """
        yield self._keys.scene, PublicScene(epoch=EPOCH, scene=self._scene)
        for what in course:
            yield from self._published()
            commands: dict[str, Command] = {}
            for robot in self._scenario.robots:
                yield from self._answered(robot, what[robot.id], commands)
            self._world.advance(commands)
        yield from self._published()
        self._world.interrupt()
        yield self._keys.truth, self._world.truth()

    def _start(self, robot: ScenarioRobot) -> Agent:
        return agent_of(robot, self._scene, self._facts, lambda: 0.0, Deadline(lambda: 0.0, None))

    def _published(self) -> Iterator[tuple[str, Message]]:
        for robot, observation in self._world.observations().items():
            yield self._keys.pose(robot), observation
        yield self._keys.truth, self._world.truth()

    def _answered(
        self, robot: ScenarioRobot, what: str, commands: dict[str, Command]
    ) -> Iterator[tuple[str, Message]]:
        if what == "asleep":
            return
        if what == "restarted":
            self._agents[robot.id] = self._start(robot)
        agent = self._agents[robot.id]
        decision = agent.decide(self._world.observations()[robot.id])
        assert decision is not None
        yield self._keys.mind(robot.id), decision.mind
        if what == "withdraws":
            agent.withdraw()
            return
        yield self._keys.command(robot.id), decision.command
        if what != "too late":
            commands[robot.id] = decision.command


def as_in_real_time(experiment: Experiment, course: Iterable[Mapping[str, str]]) -> list[BusMessage]:
    return [BusMessage(key, message, 0) for key, message in RealTime(experiment).said(course)]
