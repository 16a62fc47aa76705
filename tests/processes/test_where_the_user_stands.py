"""Runs depend on what is installed, not on the directory from which they are started."""

import json
import re

from process_helpers import lanes, write_scenario


def test_folders_named_like_packages_do_no_harm_and_the_output_goes_to_runs(tmp_path, process):
    here = tmp_path / "here"
    for name in ("agent", "world", "protocol", "scenarios"):
        (here / name).mkdir(parents=True)
        (here / name / "__init__.py").write_text(f"raise RuntimeError('the wrong {name}')")
        (here / name / "__main__.py").touch()
    write_scenario(
        here / "alone.yaml", lanes(1, 0.5), horizons={"prediction_steps": 12, "estimation_steps": 3}
    )
    run = process("told", "run", "alone.yaml", cwd=here)
    assert run.end() == 0, run.complained
    [out] = (here / "runs").iterdir()
    assert re.fullmatch(r"alone-joint-fit-\d{8}-\d{6}", out.name)
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["verdict"], summary["minimum_distance_m"]) == ("arrived", None)


def test_settings_of_the_user_s_environment_do_not_reach_the_processes(tmp_path, bench):
    """They are for processes started one by one; a run has its own."""
    scenario = write_scenario(tmp_path / "alone.yaml", lanes(1, 4.0), time_limit_s=0.5)
    strange = {"ROBOT": "9", "GOAL": "9,9,9", "RUN": "other", "CLOCK": "realtime", "EXCHANGE_GOALS": "1"}
    run = bench("out", "run", scenario, env={f"UNSPOKEN_{name}": value for name, value in strange.items()})
    assert run.end() == 1, run.complained
    assert "clock=lockstep" in run.log("world")
    assert "exchange_goals=False" in run.log("world")
    assert json.loads((run.out / "summary.json").read_text())["clock"] == "lockstep"
