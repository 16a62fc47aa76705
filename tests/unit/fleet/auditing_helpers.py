"""Recorded runs of two short-sighted robots that meet, made in this process, and their audits."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from agent.agent import Agent
from agent.process.options import DecisionOptions
from agent.solve import Deadline
from fleet.audit.recorded import open_run
from fleet.audit.replay import Audit, Report
from fleet.interruption import Interruption
from fleet.record.experiment import Experiment, prepare
from fleet.record.recording import BusMessage, Recorder
from fleet.run.virtual import EPOCH, simulate
from protocol.keys import Keys
from protocol.messages import Command, Message, PublicScene
from protocol.scenario import ScenarioRobot
from world.world import World

STEPS = 8
MEETING = [
    {"id": 1, "start": {"x_m": -1.2, "y_m": 0.0}, "goal": {"x_m": 1.2, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 1.2, "y_m": 0.1}, "goal": {"x_m": -1.2, "y_m": 0.0}},
]
DIM = {"position_noise_m": 0.01, "heading_noise_rad": 0.01, "dropout": 0.2, "delay_steps": 1}
"""Noise, dropouts and delay."""


def experiment_of(
    folder: Path,
    goals: Any = "joint-fit",
    *,
    budget_ms: float | None = None,
    reserve: bool = True,
    **rules: Any,
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
    decisions = DecisionOptions(goals=goals, budget_ms=budget_ms, reserve=reserve)
    return prepare(str(path), decisions, clock="virtual", seed=3)


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


def as_in_real_time(experiment: Experiment, course: Iterable[Mapping[str, str]]) -> list[BusMessage]:
    """A run in which robots may be late, though nothing takes any time, until it is interrupted.

    Args:
        experiment: what is run.
        course: by step, what a robot does: decides ``in time``; ``withdraws`` its command; is ``too late``
            with a command on its way; is ``asleep``; or is ``restarted`` and then decides in time.
    """
    facts, scenario = experiment.facts, experiment.scenario
    keys = Keys(facts.run)
    scene = scenario.scene(with_goals=facts.goals_are_exchanged)
    world = World(scenario, seed=facts.seed, epoch=EPOCH)
    said: list[tuple[str, Message]] = [(keys.scene, PublicScene(epoch=EPOCH, scene=scene))]

    def new_agent(robot: ScenarioRobot) -> Agent:
        return facts.agent(robot.id, robot.goal_pose(), scene, lambda: 0.0, Deadline(lambda: 0.0, None))

    def show() -> None:
        said.extend((keys.pose(robot), observation) for robot, observation in world.observations().items())
        said.append((keys.truth, world.truth()))

    agents = {robot.id: new_agent(robot) for robot in scenario.robots}
    for whims in course:
        show()
        commands: dict[str, Command] = {}
        for robot in scenario.robots:
            whim = whims[robot.id]
            if whim == "restarted":
                agents[robot.id] = new_agent(robot)
            if whim == "asleep":
                continue
            decision = agents[robot.id].decide(world.observations()[robot.id])
            assert decision is not None
            said.append((keys.mind(robot.id), decision.mind))
            if whim == "withdraws":
                agents[robot.id].withdraw()
                continue
            said.append((keys.command(robot.id), decision.command))
            if whim != "too late":
                commands[robot.id] = decision.command
        world.advance(commands)
    show()
    world.interrupt()
    said.append((keys.truth, world.truth()))
    return [BusMessage(key, message, 0) for key, message in said]
