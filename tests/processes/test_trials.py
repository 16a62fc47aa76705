"""Every case of the bundled suite of faults, in real processes."""

import json

import pytest

from fleet.trials.cases import BUNDLED, load_cases

CASES = [case.name for case in load_cases(BUNDLED)]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_what_has_to_hold_holds_in_real_processes(tmp_path, process, case):
    report = tmp_path / "report.json"
    arguments = ("--processes", "--robots", 2, "--seeds", 1, "--first-seed", 100, "--json", report)
    trial = process("trial", "faults", "--only", case, *arguments)
    assert trial.end() == 0, trial.told + trial.complained
    [result] = json.loads(report.read_text())["trials"]
    assert result["violations"] == []
