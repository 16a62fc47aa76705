"""Crossings back to back in the same processes: world and robots do not grow, nothing is lost.

The bench does, by about a kibibyte a step: it keeps every robot's way for the picture.
"""

import os
from collections import Counter
from statistics import median

import psutil
import pytest
from process_helpers import PATIENCE_S

from protocol.messages import Command, Mind, Truth
from protocol.scenario import Pose, Scenario, ScenarioRobot, scenario_text

SOAK_S = float(os.environ.get("SOAK_S", "150"))
"""Simulated seconds; an hour takes some ten minutes."""
TURN_S = 16.0
"""For so long robots are on their way and at its end. Two turn in the middle of the time of the other two, so
that somebody always drives."""
PAIRS = (("1", "3"), ("2", "4"))
BROKEN_DOWN = "5"
"""It never arrives, so that the run goes on."""
EARLY, LATE = (0.2, 0.25, 0.3), (0.9, 0.95, 0.98)
"""Parts of the run after which memory is looked at; before the first of them, pools and windows fill."""
WITHIN = 0.05


def shuttling() -> Scenario:
    """Four robots cross one another to and fro; a fifth stands aside."""
    corners = [(4.0, 1.0), (-1.0, 4.0), (-4.0, -1.0), (1.0, -4.0)]
    robots = [
        ScenarioRobot(id=name, start=Pose(x_m=x, y_m=y), goal=Pose(x_m=-x, y_m=-y))
        for name, (x, y) in zip("1234", corners, strict=True)
    ]
    aside = ScenarioRobot(id=BROKEN_DOWN, start=Pose(x_m=9.0, y_m=9.0), goal=Pose(x_m=-9.0, y_m=9.0))
    turns = {"kind": "turns-back", "duration_s": TURN_S}
    back = [
        {**turns, "robots": pair, "start_s": start_s + 0.5 * TURN_S * index}
        for start_s in range(int(TURN_S / 2), int(SOAK_S), int(2 * TURN_S))
        for index, pair in enumerate(PAIRS)
    ]
    broken = {"kind": "stops", "robots": (BROKEN_DOWN,)}
    faults = [broken, *back]
    return Scenario.model_validate(
        {"name": "soak", "time_limit_s": SOAK_S, "robots": [*robots, aside], "faults": faults}
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_for_as_long_as_robots_cross_nothing_grows_and_nothing_is_lost(tmp_path, bench):
    path = tmp_path / "soak.yaml"
    path.write_text(scenario_text(shuttling()), encoding="utf-8")
    run = bench("out", "run", path, "--goals", "joint-fit")
    steps = round(10 * SOAK_S)
    samples = {EARLY: [], LATE: []}
    for shares, sampled in samples.items():
        for share in shares:
            run.reach(round(share * steps), patience_s=PATIENCE_S + SOAK_S)
            sampled.append({pid: psutil.Process(pid).memory_info().rss for pid in run.children()})
    assert run.end() == 1, run.complained
    for pid in samples[EARLY][0]:
        before, after = (median(sample[pid] for sample in sampled) for sampled in samples.values())
        print(f"process {pid}: {before / 2**20:.1f} MiB, later {after / 2**20:.1f} MiB")
        assert after < (1.0 + WITHIN) * before
    counts = Counter((type(each), each.robot) for each in (*run.messages(Command), *run.messages(Mind)))
    last = run.messages(Truth)[-1]
    assert last.step == steps
    assert last.collisions == ()
    assert {robot.deadline_misses for robot in last.robots.values()} == {0}
    assert set(counts.values()) == {steps}
