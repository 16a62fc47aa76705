"""A run in virtual time tells what processes would have told."""

from pathlib import Path

import pytest
import yaml

from agent.agent import Agent
from agent.process.options import DecisionOptions
from fleet.interruption import Interruption
from fleet.record.stream import KINDS, BusMessage
from fleet.run.experiment import Experiment, prepare
from fleet.run.virtual import simulate
from protocol.keys import Keys

STEPS = 5


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    """Two robots that do not get far."""
    path = tmp_path / "short.yaml"
    robots = [
        {"id": i, "start": {"x_m": 0.0, "y_m": 2.0 * i}, "goal": {"x_m": 4.0, "y_m": 2.0 * i}} for i in (1, 2)
    ]
    horizons = {"prediction_steps": 4, "estimation_steps": 2}
    content = {
        "name": "short",
        "robots": robots,
        "horizons": horizons,
        "time_limit_s": 0.1 * STEPS,
        "sensing": {"position_noise_m": 0.02},
    }
    path.write_text(yaml.safe_dump(content))
    return prepare(str(path), DecisionOptions(goals="ioc", solver="reference"), clock="virtual", seed=0)


def kinds(experiment: Experiment, messages: list[BusMessage]) -> list[str]:
    return [Keys(experiment.facts.run).kind_of(message.key) for message in messages]


def test_every_message_of_the_bus_comes_in_the_order_of_the_steps(experiment: Experiment) -> None:
    messages = list(simulate(experiment, Interruption()))
    step = ["pose", "pose", "truth", "mind", "command", "mind", "command"]
    assert kinds(experiment, messages) == ["scene", *(STEPS * step), "truth"]
    assert all(
        type(message.message) is KINDS[kind]
        for message, kind in zip(messages, kinds(experiment, messages), strict=True)
    )
    assert messages[-1].message.verdict == "timeout"


def test_the_time_of_a_message_is_that_of_its_step(experiment: Experiment) -> None:
    for message in simulate(experiment, Interruption()):
        assert message.time_ns == getattr(message.message, "step", 0) * 100_000_000


def test_a_robot_decides_on_what_its_own_sensors_see(experiment: Experiment) -> None:
    keys = Keys(experiment.facts.run)
    messages = list(simulate(experiment, Interruption()))
    seen, done = (
        {
            robot: [message.message for message in messages if message.key == key(robot)]
            for robot in ("1", "2")
        }
        for key in (keys.pose, keys.command)
    )
    assert seen["1"] != seen["2"], "their sensors are noisy"
    for robot in experiment.scenario.robots:
        agent = Agent.of(
            robot.id,
            robot.goal_pose(),
            experiment.scenario.scene(with_goals=False),
            goals="ioc",
            solver="reference",
            clock=lambda: 0.0,
        )
        decisions = [agent.decide(observation) for observation in seen[robot.id]]
        assert [decision and decision.command for decision in decisions] == done[robot.id]


def test_an_interrupted_simulation_ends_with_that_verdict_at_the_present_step(experiment: Experiment) -> None:
    interruption = Interruption()
    messages = []
    for message in simulate(experiment, interruption):
        messages.append(message)
        interruption.requested = getattr(message.message, "step", 0) >= 2
    last = messages[-1].message
    assert (last.step, last.verdict) == (2, "interrupted")
    assert kinds(experiment, messages).count("truth") == 4, "steps 0, 1 and 2, and the verdict"
