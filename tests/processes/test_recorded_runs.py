"""What a run in processes leaves behind, and what its messages keep to themselves."""

import json
from collections import Counter

import pytest
from process_helpers import Bench, recorded, write_scenario

ROBOTS = ("1", "2", "3")
# Numbers that come up nowhere else.
# Long numbers, which no other number of a run begins with by chance.
GOALS = [
    (0.37194182, 0.02376193, 0.08715374),
    (0.39237415, 2.04193516, -0.06137192),
    (0.41274938, 4.03119427, 0.05394815),
]
STEPS = 10


def leave_output(folder, temporary, goals):
    scenario = write_scenario(
        folder / "parallel.yaml",
        [
            {
                "id": robot,
                "start": {"x_m": 0.0, "y_m": 2.0 * index, "heading_rad": 0.0},
                "goal": dict(zip(("x_m", "y_m", "heading_rad"), goal, strict=True)),
            }
            for index, (robot, goal) in enumerate(zip(ROBOTS, GOALS, strict=True))
        ],
        time_limit_s=0.1 * STEPS,
    )
    with Bench(folder / goals, temporary, "run", scenario, "--goals", goals) as run:
        assert run.end() == 1, run.complained
    return run.out


@pytest.fixture
def out(tmp_path, temporary):
    return leave_output(tmp_path, temporary, "ioc")


def leaks(messages, kinds):
    """Every number of a goal found in messages of these kinds."""
    texts = [message.model_dump_json() for key, message in messages if key.partition("/")[0] in kinds]
    numbers = {f"{number}" for goal in GOALS for number in goal if number != 0.0}
    return {number for number in numbers for text in texts if number in text}


def test_a_run_leaves_its_summary_recording_picture_and_logs(out):
    assert {path.name for path in out.iterdir()} == {"summary.json", "run.mcap", "paths.png", "logs"}
    assert {path.name for path in (out / "logs").iterdir()} == {
        "world.log",
        *(f"robot-{robot}.log" for robot in ROBOTS),
    }
    assert (out / "paths.png").read_bytes().startswith(b"\x89PNG")

    messages = recorded(out)
    assert Counter(key for key, _ in messages) == {
        "scene": 1,
        "truth": STEPS + 1,
        **{f"{kind}/{robot}": STEPS for kind in ("pose", "command", "mind") for robot in ROBOTS},
    }
    for kind in ("pose", "command", "mind"):
        for robot in ROBOTS:
            assert [m.step for key, m in messages if key == f"{kind}/{robot}"] == list(range(STEPS))
    assert len({message.epoch for _, message in messages}) == 1

    assert leaks(messages, {"scene", "pose", "command", "truth"}) == set()

    summary = json.loads((out / "summary.json").read_text())
    robots, phases = summary.pop("robots"), summary.pop("phases_ms")
    distance_m = summary.pop("minimum_distance_m")
    assert distance_m == pytest.approx(2.0, abs=0.1)
    assert summary == {
        "schema": 1,
        "scenario": "parallel",
        "goals": "ioc",
        "solver": "realtime",
        "iterations": 2,
        "budget_ms": None,
        "clock": "lockstep",
        "seed": 0,
        "verdict": "timeout",
        "duration_s": None,
        "steps": STEPS,
        "collisions": 0,
        "solver_failures": 0,
        "deadline_misses": 0,
        "clipped_commands": 0,
        "refused": {},
        "interventions": 0,
        "degraded": {},
        "restarts": {},
    }
    assert [robot["id"] for robot in robots] == list(ROBOTS)
    for robot in robots:
        assert set(robot) == {"id", "arrived_s", "driven_m", "solver_failures", "deadline_misses"}
        assert robot["arrived_s"] is None
        assert 0.0 < robot["driven_m"] < 0.5
    assert set(phases) == {"estimate", "predict", "plan", "decide"}
    for phase in phases.values():
        assert set(phase) == {"p50", "p99", "max"}
        assert 0.0 < phase["p50"] <= phase["p99"] <= phase["max"]


def test_only_exchanged_goals_are_told_and_only_by_the_scene(tmp_path, temporary):
    """This also shows that the search of the other test finds goals where there are any."""
    messages = recorded(leave_output(tmp_path, temporary, "exchanged"))
    assert leaks(messages, {"scene"}) == {f"{number}" for goal in GOALS for number in goal}
    assert leaks(messages, {"pose", "command", "truth"}) == set()
