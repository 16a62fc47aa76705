"""The published scenario in nine processes."""

import json

import pytest


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("goals", ["exchanged", "ioc"])
def test_eight_robots_cross_in_nine_processes_without_a_collision(bench, goals):
    run = bench("out", "run", "8a", "--goals", goals)
    run.reach(1)
    children = run.children()
    assert sorted(line[-1] for line in children.values()) == ["agent"] * 8 + ["world"]
    assert run.end(1400.0) == 0, run.complained
    run.leaves_nothing(children)
    summary = json.loads((run.out / "summary.json").read_text())
    assert (summary["verdict"], summary["collisions"]) == ("arrived", 0)
    assert all(robot["arrived_s"] is not None for robot in summary["robots"])
    assert "All 8 robots arrived" in run.told
