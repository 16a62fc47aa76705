"""An experiment is a scenario, bundled or one's own, and what to do with it."""

from pathlib import Path

import pytest

from agent.process.options import DecisionOptions
from chassis.refusal import Refusal
from fleet.run.experiment import prepare
from protocol.keys import Keys
from scenarios import find

CHOICES = {"decisions": DecisionOptions(goals="ioc", solver="reference"), "clock": "lockstep", "seed": 5}


def test_a_bundled_scenario_is_found_by_its_name_and_the_facts_are_the_options() -> None:
    experiment = prepare("8a", **CHOICES)
    assert len(experiment.scenario.robots) == 8
    facts = experiment.facts
    assert (facts.scenario, facts.clock, facts.seed) == ("8a", "lockstep", 5)
    assert (
        DecisionOptions(**facts.model_dump(include=set(DecisionOptions.model_fields))) == CHOICES["decisions"]
    )


def test_a_file_is_found_from_wherever_the_processes_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.yaml").write_text(find("2-crossing").read_text())
    monkeypatch.chdir(tmp_path)
    assert prepare("mine.yaml", **CHOICES).path == tmp_path.resolve() / "mine.yaml"


def test_every_run_has_a_name_of_its_own_that_can_stand_in_a_key() -> None:
    runs = {prepare("2-crossing", **CHOICES).facts.run for _ in range(20)}
    assert len(runs) == 20
    for run in runs:
        assert Keys(run).run == run


@pytest.mark.parametrize(
    ("goals", "exchanged"), [("exchanged", True), ("ioc", False), ("constant-acceleration", False)]
)
def test_goals_are_known_to_all_only_when_they_are_to_be_exchanged(goals: str, exchanged: bool) -> None:
    decisions = DecisionOptions(goals=goals)
    assert prepare("2-crossing", decisions, clock="virtual", seed=0).facts.goals_are_exchanged is exchanged


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


def test_an_unknown_scenario_is_an_error_that_names_the_known_ones() -> None:
    with pytest.raises(Refusal, match=r"8b.*2-crossing, 3-crossing, 4-crossing, 8a"):
        prepare("8b", **CHOICES)
