"""What real processes have recorded can be repeated in one process, decision by decision."""

import json
import signal

import pytest
from process_helpers import SHORT_SIGHTED, bundled_with, endless, lanes, recorded, write_scenario

NOISY = {"position_noise_m": 0.01, "dropout": 0.1}


@pytest.fixture
def audited(tmp_path, process):
    """The report on a run that should follow."""

    def audit(run):
        report = tmp_path / "audit.json"
        auditing = process("audit", "audit", run.out, "--json", report)
        assert auditing.end() == 0, auditing.told + auditing.complained
        return json.loads(report.read_text())

    return audit


def numbers(report, kind):
    """How many messages of a kind are recorded by robot; all of them are identical in the repetition."""
    assert all(robot[kind]["recorded"] == robot[kind]["identical"] for robot in report["robots"])
    return {robot["id"]: robot[kind]["recorded"] for robot in report["robots"]}


def test_a_run_in_lock_step_follows(tmp_path, bench, process, audited):
    scenario = bundled_with(
        tmp_path / "scenario.yaml", "2-crossing", horizons=SHORT_SIGHTED, time_limit_s=2.0, sensing=NOISY
    )
    run = bench("out", "run", scenario, "--seed", 5)
    assert run.end() == 1, run.complained
    report = audited(run)
    for kind in ("observations", "minds", "commands"):
        assert numbers(report, kind) == {"1": 20, "2": 20}
    assert (report["result"], report["verdict"], report["goals_told"]) == ("follows", "timeout", False)

    replay = process("replay", "replay", run.out / "run.mcap", "--robot", "2", "--steps")
    assert replay.end() == 0, replay.complained
    assert "All 20 decisions of robot 2 follow" in replay.told


@pytest.mark.slow
def test_a_run_in_real_time_follows_though_the_clock_cut_decisions_short(tmp_path, bench, audited):
    scenario = bundled_with(tmp_path / "scenario.yaml", "2-crossing", time_limit_s=3.0)
    run = bench("out", "run", scenario, "--clock", "realtime", "--budget-ms", 2)
    assert run.end() == 1, run.complained
    minds = [message for key, message in recorded(run.out) if key.startswith("mind/")]
    assert any(mind.cut_short_at is not None for mind in minds)
    report = audited(run)
    assert numbers(report, "observations") == {"1": 30, "2": 30}
    assert sum(numbers(report, "minds").values()) == len(minds)


@pytest.mark.slow
def test_a_run_follows_though_its_robots_were_too_slow_for_most_steps(tmp_path, bench, audited):
    """With steps of a millisecond, the reference solver cannot keep up."""
    scenario = write_scenario(tmp_path / "hasty.yaml", lanes(2, 9.0), step_s=0.001, time_limit_s=0.5)
    run = bench("out", "run", scenario, "--clock", "realtime", "--solver", "reference")
    assert run.end() == 1, run.complained
    report = audited(run)
    minds, commands = numbers(report, "minds"), numbers(report, "commands")
    assert sum(commands.values()) < sum(minds.values())
    assert all(minds[robot] < seen for robot, seen in numbers(report, "observations").items())


@pytest.mark.slow
def test_a_run_follows_up_to_where_it_was_interrupted(tmp_path, bench, audited):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(10)
    run.signal(signal.SIGINT)
    assert run.end() == 1, run.complained
    report = audited(run)
    assert report["verdict"] == "interrupted"
    assert report["last_step"] >= 10
    assert numbers(report, "observations") == dict.fromkeys("12", report["last_step"] + 1)
