"""An experiment is a scenario and what to do with it; in virtual time it tells what processes would tell."""

from pathlib import Path

import pytest
import yaml

from agent.process.options import DecisionOptions
from chassis.refusal import Refusal
from fleet.interruption import Interruption
from fleet.record.experiment import Experiment, prepare
from fleet.record.recording import KINDS, BusMessage
from fleet.run.virtual import simulate
from protocol.keys import Keys
from scenarios import find

STEPS = 5
CHOICES = {"decisions": DecisionOptions(goals="ioc", solver="reference"), "clock": "lockstep", "seed": 5}


def test_a_bundled_scenario_is_found_by_its_name_and_the_facts_are_the_options() -> None:
    experiment = prepare("8a", **CHOICES)
    assert len(experiment.scenario.robots) == 8
    facts = experiment.facts
    assert (facts.scenario, facts.clock, facts.seed) == ("8a", "lockstep", 5)
    assert DecisionOptions(**facts.decisions()) == CHOICES["decisions"]
    with pytest.raises(Refusal, match=r"8b.*2-crossing, 3-crossing, 4-crossing, 8a"):
        prepare("8b", **CHOICES)


def test_a_file_is_found_from_wherever_the_processes_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.yaml").write_text(find("2-crossing").read_text())
    monkeypatch.chdir(tmp_path)
    assert prepare("mine.yaml", **CHOICES).path == tmp_path.resolve() / "mine.yaml"


def test_every_run_has_a_name_of_its_own_that_can_stand_in_a_key() -> None:
    runs = {prepare("2-crossing", **CHOICES).facts.run for _ in range(5)}
    assert len({Keys(run).run for run in runs}) == 5


@pytest.mark.parametrize(
    ("clock", "given", "budget_ms"),
    [
        ("realtime", None, 50.0),
        ("lockstep", None, None),
        ("virtual", None, None),
        ("realtime", 0.0, 0.0),
        ("lockstep", 7.0, 7.0),
    ],
)
def test_without_a_budget_decisions_have_half_a_step_in_real_time_and_all_time_otherwise(
    clock: str, given: float | None, budget_ms: float | None
) -> None:
    experiment = prepare("8a", DecisionOptions(budget_ms=given), clock=clock, seed=0)
    assert experiment.facts.budget_ms == budget_ms


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Two robots that do not get far."""
    path = tmp_path_factory.mktemp("short") / "short.yaml"
    robots = [
        {"id": i, "start": {"x_m": 0.0, "y_m": 2.0 * i}, "goal": {"x_m": 4.0, "y_m": 2.0 * i}} for i in (1, 2)
    ]
    content = {
        "name": "short",
        "robots": robots,
        "horizons": {"prediction_steps": 4, "estimation_steps": 2},
        "time_limit_s": 0.1 * STEPS,
        "sensing": {"position_noise_m": 0.02},
    }
    path.write_text(yaml.safe_dump(content))
    return prepare(str(path), DecisionOptions(goals="constant-acceleration"), clock="virtual", seed=0)


@pytest.fixture(scope="module")
def messages(experiment: Experiment) -> list[BusMessage]:
    return list(simulate(experiment, Interruption()))


def kinds(experiment: Experiment, messages: list[BusMessage]) -> list[str]:
    return [Keys(experiment.facts.run).kind_of(message.key) for message in messages]


def test_every_message_of_the_bus_comes_in_the_order_of_the_steps_and_at_their_time(
    experiment: Experiment, messages: list[BusMessage]
) -> None:
    step = ["pose", "pose", "truth", "mind", "command", "mind", "command"]
    found = kinds(experiment, messages)
    assert found == ["scene", *(STEPS * step), "truth"]
    for kind, (_, message, time_ns) in zip(found, messages, strict=True):
        assert type(message) is KINDS[kind]
        assert time_ns == getattr(message, "step", 0) * 100_000_000
    assert messages[-1].message.verdict == "timeout"


def test_a_robot_decides_on_what_its_own_sensors_see(
    experiment: Experiment, messages: list[BusMessage]
) -> None:
    keys = Keys(experiment.facts.run)
    seen, done = (
        {name: [each.message for each in messages if each.key == key(name)] for name in ("1", "2")}
        for key in (keys.pose, keys.command)
    )
    assert seen["1"] != seen["2"], "their sensors are noisy"
    for robot in experiment.scenario.robots:
        scene = experiment.scenario.scene(with_goals=False)
        agent = experiment.facts.agent(robot.id, robot.goal_pose(), scene, lambda: 0.0)
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
