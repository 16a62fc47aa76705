"""An experiment is a scenario, bundled or one's own, and what to do with it."""

from pathlib import Path

import pytest

from chassis.refusal import Refusal
from fleet.run.experiment import prepare
from protocol.keys import Keys
from scenarios import find

CHOICES = {"goals": "ioc", "solver": "reference", "clock": "lockstep", "seed": 5}


def test_a_bundled_scenario_is_found_by_its_name() -> None:
    experiment = prepare("8a", **CHOICES)
    assert len(experiment.scenario.robots) == 8
    facts = experiment.facts
    assert (facts.scenario, facts.goals, facts.solver, facts.clock, facts.seed) == (
        "8a",
        "ioc",
        "reference",
        "lockstep",
        5,
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
def test_goals_are_told_only_when_they_are_to_be_exchanged(goals: str, exchanged: bool) -> None:
    assert prepare("2-crossing", **{**CHOICES, "goals": goals}).facts.goals_are_exchanged is exchanged


@pytest.mark.parametrize(("clock", "budget_ms"), [("realtime", 50.0), ("lockstep", None), ("virtual", None)])
def test_decisions_have_half_a_step_in_real_time_and_all_time_otherwise(
    clock: str, budget_ms: float | None
) -> None:
    assert prepare("8a", **{**CHOICES, "clock": clock}).facts.budget_ms == budget_ms


@pytest.mark.parametrize("clock", ["realtime", "lockstep"])
def test_a_budget_that_is_given_counts(clock: str) -> None:
    assert prepare("8a", **{**CHOICES, "clock": clock}, budget_ms=0.0).facts.budget_ms == 0.0


def test_an_unknown_scenario_is_an_error_that_names_the_known_ones() -> None:
    with pytest.raises(Refusal, match=r"8b.*2-crossing, 3-crossing, 4-crossing, 8a"):
        prepare("8b", **CHOICES)
