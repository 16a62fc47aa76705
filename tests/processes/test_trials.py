"""Every case of the bundled suite of faults: those of processes in real ones, the others in virtual time.

That links and minds break in processes as they do in virtual time is shown by test_faults_links.
"""

import json

import pytest

from fleet.faults.cases import BUNDLED, load_cases

CASES = load_cases(BUNDLED)
BY_NAME = {"kill", "kill-and-restart", "freeze", "slow", "restart-world"}
OF_PROCESSES = [case.name for case in CASES if case.needs_processes or case.name in BY_NAME]
OTHERS = [case.name for case in CASES if case.name not in OF_PROCESSES]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cases", "options"),
    [(OF_PROCESSES[::2], ["--processes"]), (OF_PROCESSES[1::2], ["--processes"]), (OTHERS, ["--workers", 1])],
    ids=["some of processes", "other of processes", "of links and minds"],
)
def test_what_has_to_hold_holds(tmp_path, process, cases, options):
    report = tmp_path / "report.json"
    only = [option for case in cases for option in ("--only", case)]
    arguments = (*options, "--robots", 2, "--seeds", 1, "--first-seed", 100, "--json", report)
    trials = process("trials", "faults", *only, *arguments)
    assert trials.end(patience_s=800.0) == 0, trials.told + trials.complained
    found = {trial["case"]: trial["violations"] for trial in json.loads(report.read_text())["trials"]}
    assert found == {case: [] for case in cases}
