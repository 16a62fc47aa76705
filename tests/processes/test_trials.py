"""Every case of the bundled suite of faults, in real processes."""

import json

import pytest

from fleet.faults.cases import BUNDLED, load_cases

CASES = [case.name for case in load_cases(BUNDLED)]
GROUPS = [CASES[first::5] for first in range(5)]
"""Of one command each, which costs less time to start than one a case."""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("cases", GROUPS, ids=", ".join)
def test_what_has_to_hold_holds_in_real_processes(tmp_path, process, cases):
    report = tmp_path / "report.json"
    only = [option for case in cases for option in ("--only", case)]
    arguments = ("--processes", "--robots", 2, "--seeds", 1, "--first-seed", 100, "--json", report)
    trials = process("trials", "faults", *only, *arguments)
    assert trials.end(patience_s=800.0) == 0, trials.told + trials.complained
    found = {trial["case"]: trial["violations"] for trial in json.loads(report.read_text())["trials"]}
    assert found == {case: [] for case in cases}
