"""What an evaluation leaves behind survives every interruption and mixes with no other one."""

from pathlib import Path
from typing import Any

import pytest
from evaluation_helpers import evaluation_of, write_suite

from chassis.refusal import Refusal
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.results import (
    COLUMNS,
    RUNS,
    Results,
    Row,
    RunKey,
    read_evaluation,
    read_rows,
)

KEY = RunKey("one", "ioc", "realtime", "none", 0)
FAILED = Row.without_result(KEY, 2, 'ValueError: a comma, a "quote"\nand a line break')
FINISHED = Row(
    **KEY._replace(seed=1)._asdict(),
    robots=2,
    verdict="arrived",
    duration_s=0.1 + 0.2,
    minimum_distance_m=1.0 / 3.0,
    collisions=0,
)


@pytest.fixture
def evaluation(tmp_path: Path) -> Evaluation:
    return evaluation_of(write_suite(tmp_path / "suite", "one", "two"))


def test_rows_are_read_as_they_were_written_bit_for_bit(tmp_path: Path, evaluation: Evaluation):
    with Results(tmp_path / "out", evaluation) as results:
        results.add(FAILED)
        results.add(FINISHED)
        assert read_rows(tmp_path / "out") == [FAILED, FINISHED], "kept at once, not at the end"
    assert FAILED.reason == 'ValueError: a comma, a "quote" and a line break'
    with Results(tmp_path / "out", evaluation) as resumed:
        assert resumed.rows == {FAILED.key: FAILED, FINISHED.key: FINISHED}


def test_the_settings_are_read_as_they_were_written(tmp_path: Path, evaluation: Evaluation):
    with Results(tmp_path / "out", evaluation):
        pass
    assert read_evaluation(tmp_path / "out") == evaluation


def test_whatever_part_of_the_last_row_was_written_is_dropped(tmp_path: Path, evaluation: Evaluation):
    out = tmp_path / "out"
    with Results(out, evaluation) as results:
        results.add(FAILED)
        whole = (out / RUNS).read_bytes()
        results.add(FINISHED)
    longer = (out / RUNS).read_bytes()
    for length in range(len(whole), len(longer)):
        (out / RUNS).write_bytes(longer[:length])
        assert read_rows(out) == [FAILED]
        with Results(out, evaluation) as resumed:
            assert list(resumed.rows) == [FAILED.key]
            resumed.add(FINISHED)
        assert (out / RUNS).read_bytes() == longer


def test_a_header_that_was_half_written_is_written_anew(tmp_path: Path, evaluation: Evaluation):
    with Results(tmp_path / "out", evaluation):
        pass
    (tmp_path / "out" / RUNS).write_text("scenario,rob")
    with Results(tmp_path / "out", evaluation):
        pass
    assert (tmp_path / "out" / RUNS).read_text() == ",".join(COLUMNS) + "\n"


@pytest.mark.parametrize(
    ("choices", "told"),
    [
        ({"seeds": 2}, ["seeds: 1 there, 2 here"]),
        ({"goals": ("ioc",)}, ["goals: exchanged,ioc there, ioc here"]),
        ({"solver": "reference"}, ["solver: realtime there, reference here"]),
        ({"noise": ("none", "low")}, ["noise: none there, none,low here"]),
        ({"suite": "other"}, ["suite: suite there, other here"]),
        ({"machine": {"version": "9.9.9"}}, ["version: 0.1.0 there, 9.9.9 here"]),
        ({"machine": {"commit": "abcdef0"}}, ["commit: 1234567 there, abcdef0 here"]),
        (
            {"scenarios": {"one": {"time_limit_s": 0.7}, "three": {}}},
            ["scenario one: changed", "scenario two: there only", "scenario three: here only"],
        ),
    ],
)
def test_what_differs_from_the_evaluation_of_a_directory_is_told_and_it_is_left_alone(
    tmp_path: Path, evaluation: Evaluation, choices: dict[str, Any], told: list[str]
):
    there = evaluation.model_copy(
        update={"machine": evaluation.machine.model_copy(update={"commit": "1234567", "version": "0.1.0"})}
    )
    with Results(tmp_path / "out", there):
        pass
    if "machine" in choices:
        choices = {"machine": there.machine.model_copy(update=choices["machine"])}
    if "scenarios" in choices:
        one = evaluation.scenarios["one"]
        changed = {stem: one.model_copy(update=how) for stem, how in choices["scenarios"].items()}
        choices = {"scenarios": changed}
    with pytest.raises(Refusal) as refusal, Results(tmp_path / "out", there.model_copy(update=choices)):
        pass
    assert [line.strip() for line in str(refusal.value).splitlines()[1:-1]] == told


def test_results_can_be_resumed_on_another_machine(tmp_path: Path, evaluation: Evaluation):
    with Results(tmp_path / "out", evaluation) as results:
        results.add(FAILED)
    machine = evaluation.machine.model_copy(update={"cpu": "another one", "cores": 64})
    with Results(tmp_path / "out", evaluation.model_copy(update={"machine": machine})) as resumed:
        assert list(resumed.rows) == [FAILED.key]


def test_two_evaluations_cannot_write_to_one_directory_at_a_time(tmp_path: Path, evaluation: Evaluation):
    with (
        Results(tmp_path / "out", evaluation),
        pytest.raises(match="another evaluation is writing there"),
        Results(tmp_path / "out", evaluation),
    ):
        pass


def test_a_directory_of_something_else_is_left_alone(tmp_path: Path, evaluation: Evaluation):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(match="holds no evaluation"), Results(tmp_path, evaluation):
        pass
    assert not (tmp_path / RUNS).exists()


@pytest.mark.parametrize("damage", ["one,2", "one,two" + "," * (len(COLUMNS) - 2)])
def test_a_damaged_row_is_told_with_its_line(tmp_path: Path, evaluation: Evaluation, damage: str):
    with Results(tmp_path / "out", evaluation) as results:
        results.add(FAILED)
    with (tmp_path / "out" / RUNS).open("a") as file:
        file.write(damage + "\n")
    with pytest.raises(match=r"runs\.csv:3: not a row"), Results(tmp_path / "out", evaluation):
        pass
