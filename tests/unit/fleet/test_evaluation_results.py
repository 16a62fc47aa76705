"""What an evaluation leaves behind survives every interruption and mixes with no other one."""

from pathlib import Path
from typing import Any

import pytest
from evaluation_helpers import evaluation_of, write_suite

from chassis.refusal import Refusal
from fleet.evaluate.evaluation import Evaluation
from fleet.evaluate.results import COLUMNS, RUNS, Row, open_results, read_evaluation, read_rows


@pytest.fixture
def evaluation(tmp_path: Path) -> Evaluation:
    return evaluation_of(write_suite(tmp_path / "suite", "one", "two"))


@pytest.fixture
def failed(evaluation: Evaluation) -> Row:
    run, *_ = evaluation.runs()
    return Row.without_result(run, 'ValueError: a comma, a "quote"\nand a line break')


@pytest.fixture
def finished(evaluation: Evaluation) -> Row:
    *_, run = evaluation.runs()
    figures = {"duration_s": 0.1 + 0.2, "minimum_distance_m": 1.0 / 3.0, "collisions": 0}
    return Row(**run.key._asdict(), robots=2, verdict="arrived", **figures)


def test_all_is_kept_at_once_and_read_as_it_was_written_bit_for_bit(
    tmp_path: Path, evaluation: Evaluation, failed: Row, finished: Row
):
    with open_results(tmp_path / "out", evaluation) as results:
        results.add(failed)
        results.add(finished)
        assert read_rows(tmp_path / "out") == [failed, finished]
    assert failed.reason == 'ValueError: a comma, a "quote" and a line break'
    with open_results(tmp_path / "out", evaluation) as resumed:
        assert resumed.rows == {failed.key: failed, finished.key: finished}
    assert read_evaluation(tmp_path / "out") == evaluation


def test_whatever_was_written_of_a_header_or_of_the_last_row_is_dropped(
    tmp_path: Path, evaluation: Evaluation, failed: Row
):
    out = tmp_path / "out"
    with open_results(out, evaluation) as results:
        results.add(failed)
    whole = (out / RUNS).read_bytes()
    header = len(",".join(COLUMNS)) + 1
    for length in range(0, len(whole), 7):
        (out / RUNS).write_bytes(whole[:length])
        assert read_rows(out) == []
        with open_results(out, evaluation) as resumed:
            assert (out / RUNS).read_bytes() == whole[:header]
            resumed.add(failed)
        assert (out / RUNS).read_bytes() == whole


@pytest.mark.parametrize(
    ("choices", "told"),
    [
        ({"seeds": 2}, ["seeds: 1 there, 2 here"]),
        ({"goals": ("ioc",)}, ["goals: exchanged,ioc there, ioc here"]),
        ({"solver": "reference"}, ["solver: realtime there, reference here"]),
        ({"noise": ("none", "low")}, ["noise: none there, none,low here"]),
        ({"suite": "other"}, ["suite: suite there, other here"]),
        ({"version": "9.9.9"}, ["version: 0.1.0 there, 9.9.9 here"]),
        ({"commit": "abcdef0"}, ["commit: 1234567 there, abcdef0 here"]),
        (
            {"scenarios": {"one": {"time_limit_s": 0.7}, "three": {}}},
            ["scenario one: changed", "scenario two: there only", "scenario three: here only"],
        ),
        ({"cpu": "another one", "cores": 64}, []),
    ],
)
def test_what_differs_from_the_evaluation_of_a_directory_is_told_but_the_machine_may_be_another(
    evaluation: Evaluation, choices: dict[str, Any], told: list[str]
):
    machine = evaluation.machine.model_copy(update={"commit": "1234567", "version": "0.1.0"})
    there = evaluation.model_copy(update={"machine": machine})
    if choices.keys() <= type(machine).model_fields.keys():
        choices = {"machine": machine.model_copy(update=choices)}
    if "scenarios" in choices:
        one = evaluation.scenarios["one"]
        changed = {stem: one.model_copy(update=how) for stem, how in choices["scenarios"].items()}
        choices = {"scenarios": changed}
    assert there.differences(there.model_copy(update=choices)) == told


def test_two_evaluations_cannot_write_to_one_directory_at_a_time(tmp_path: Path, evaluation: Evaluation):
    with (
        open_results(tmp_path / "out", evaluation),
        pytest.raises(Refusal, match="another evaluation is writing there"),
        open_results(tmp_path / "out", evaluation),
    ):
        pass


def test_a_directory_of_something_else_or_of_a_different_evaluation_is_left_alone(
    tmp_path: Path, evaluation: Evaluation
):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(Refusal, match="holds no evaluation"), open_results(tmp_path, evaluation):
        pass
    assert not (tmp_path / RUNS).exists()
    with open_results(tmp_path / "out", evaluation):
        pass
    other = evaluation.model_copy(update={"seeds": 2})
    with pytest.raises(Refusal, match="  seeds: 1 there, 2 here\n"), open_results(tmp_path / "out", other):
        pass
    assert read_evaluation(tmp_path / "out") == evaluation


@pytest.mark.parametrize("damage", ["one,2", "one,two" + "," * (len(COLUMNS) - 2)])
def test_a_damaged_row_is_told_with_its_line(
    tmp_path: Path, evaluation: Evaluation, failed: Row, damage: str
):
    with open_results(tmp_path / "out", evaluation) as results:
        results.add(failed)
    with (tmp_path / "out" / RUNS).open("a") as file:
        file.write(damage + "\n")
    with pytest.raises(Refusal, match=r"runs\.csv:3: not a row"), open_results(tmp_path / "out", evaluation):
        pass
