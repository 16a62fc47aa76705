"""``unspoken faults`` as a person and as a script see it."""

import json
import pickle
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from fleet.cli import app
from fleet.faults import command
from fleet.faults.cases import BUNDLED, load_cases
from fleet.faults.trial import Outcome, Trial

QUICK = ("--robots", "2", "--seeds", "1", "--goals", "exchanged")


def unspoken_faults(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["faults", *map(str, arguments)])


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials are made here, and go to and fro as to workers."""

    def made(_cluster: None, trials: Iterable[Trial], make: Callable[[Trial], Outcome], *_: object) -> Any:
        return (pickle.loads(pickle.dumps(make(pickle.loads(pickle.dumps(trial))))) for trial in trials)

    monkeypatch.setattr(command, "local_cluster", lambda _workers: nullcontext())
    monkeypatch.setattr(command, "outcomes", made)


def suite(path: Path, *cases: str) -> Path:
    path.write_text("cases:\n" + "".join(f"  - {case}\n" for case in cases), encoding="utf-8")
    return path


@pytest.mark.usefixtures("in_this_process")
def test_what_holds_is_a_row_and_a_trial_of_the_report(tmp_path: Path):
    path = tmp_path / "report.json"
    result = unspoken_faults("--only", "duplication", "--only", "leaves", *QUICK, "--json", path)
    assert result.exit_code == 0, result.output
    report = json.loads(path.read_text())
    assert (report["schema"], report["complete"]) == (1, True)
    assert [(each["case"], each["robots"], each["seed"]) for each in report["trials"]] == [
        ("duplication", 2, 0),
        ("leaves", 2, 0),
    ]
    for trial in report["trials"]:
        assert (trial["verdict"], trial["violations"]) == ("arrived", [])
    rows = [line.split()[:4] for line in result.stdout.splitlines() if line.strip()]
    assert ["duplication", "1", "1", "1"] in rows
    assert ["all", "2", "2", "2"] in rows


@pytest.mark.usefixtures("in_this_process")
def test_what_does_not_hold_is_told_with_the_command_that_repeats_it(tmp_path: Path):
    # A robot that is killed for good does not arrive.
    case = "{name: doomed, faults: [{kind: kill, robots: [1], start_s: 0.5}], everybody_arrives: true}"
    path = suite(tmp_path / "suite.yaml", case)
    result = unspoken_faults(path, *QUICK, "--first-seed", 3)
    assert result.exit_code == 1, result.output
    assert "doomed, 2 robots, seed 3: robot 1 did not arrive" in result.stdout
    repeat = f"unspoken faults {path} --goals exchanged --only doomed --robots 2 --first-seed 3 --seeds 1"
    assert repeat in result.stdout
    again = CliRunner().invoke(app, repeat.split()[1:])
    assert again.exit_code == 1
    assert "doomed, 2 robots, seed 3: robot 1 did not arrive" in again.stdout


LEAVES = "{name: a, faults: [{kind: leaves, robots: [1]}]}"


@pytest.mark.parametrize(
    ("cases", "options", "said"),
    [
        (["{name: a, faults: [{kind: kil, robots: [1]}]}"], [], "suite.yaml:2: cases[0].faults[0].kind: "),
        (["{name: a, faults: []}"], [], "suite.yaml:2: cases[0].faults: "),
        (["{name: a, fault: [{kind: pause}]}"], [], "did you mean 'faults'?"),
        (["{name: A b, faults: [{kind: pause}]}"], [], "suite.yaml:2: cases[0].name: "),
        ([LEAVES, LEAVES], [], "the name 'a' is used twice"),
        ([LEAVES], ["--only", "earthquake"], "'earthquake' found"),
        (["{name: a, faults: [{kind: pause}]}"], [], "--processes"),
        (["{name: a, faults: [{kind: stops, robots: [3]}]}"], ["--robots", "2,4"], "there is no robot '3'"),
    ],
)
def test_a_suite_that_cannot_be_tried_is_refused(
    tmp_path: Path, cases: list[str], options: list[str], said: str
):
    result = unspoken_faults(suite(tmp_path / "suite.yaml", *cases), *options)
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
    assert "Traceback" not in result.output


def test_every_case_of_the_bundled_suite_befalls_robot_1_or_all_and_has_time_to_settle():
    for case in load_cases(BUNDLED):
        for fault in case.faults:
            assert getattr(fault, "robots", None) in (None, ("1",)), case.name
            assert case.settles_s is None or fault.duration_s is not None, case.name
