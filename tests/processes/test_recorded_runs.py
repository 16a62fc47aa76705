"""What a run in processes records: the same as in virtual time, all that repeats it, and no goals."""

from collections import Counter

import pytest
from process_helpers import Bench, audited, numbers, recorded, repeatable, write_scenario

GOALS = [(5.37194182, 0.02376193, 0.08715374), (0.41274938, 4.03119427, -1.55394815)]
"""Long numbers, which no other number of a run begins with by chance."""
ROBOTS = ("1", "2")
STEPS = 20
"""So many that the inverse problem has begun."""
SENSING = {"position_noise_m": 0.02, "heading_noise_rad": 0.01, "dropout": 0.1, "delay_steps": 2}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Two robots that are soon in each other's way, seen late and with noise."""
    starts = ({"x_m": 0.0, "y_m": 1.0}, {"x_m": 1.5, "y_m": -0.5, "heading_rad": 1.6})
    robots = [
        {"id": robot, "start": start, "goal": dict(zip(("x_m", "y_m", "heading_rad"), goal, strict=True))}
        for robot, start, goal in zip(ROBOTS, starts, GOALS, strict=True)
    ]
    horizons = {"prediction_steps": 12, "estimation_steps": 6}
    path = tmp_path_factory.mktemp("scenario") / "meeting.yaml"
    return write_scenario(path, robots, time_limit_s=0.1 * STEPS, sensing=SENSING, horizons=horizons)


@pytest.fixture(scope="module")
def run(tmp_path_factory, scenario):
    """In processes; it has ended."""
    folder = tmp_path_factory.mktemp("run")
    with Bench(folder / "out", "run", scenario, "--goals", "ioc", "--seed", 3) as run:
        assert run.end() == 1, run.complained
        yield run


def leaks(messages, kinds):
    """Every number of a goal found in messages of these kinds."""
    texts = [message.model_dump_json() for key, message in messages if key.partition("/")[0] in kinds]
    return {number for goal in GOALS for number in goal if any(str(number) in text for text in texts)}


def test_it_leaves_its_summary_recording_picture_and_logs(run):
    assert {path.name for path in run.out.iterdir()} == {"summary.json", "run.mcap", "paths.png", "logs"}
    assert {path.stem for path in (run.out / "logs").iterdir()} == {"world", "robot-1", "robot-2"}
    assert (run.out / "paths.png").read_bytes().startswith(b"\x89PNG")
    summary = run.summary
    told = ("scenario", "goals", "solver", "clock", "seed", "verdict", "steps")
    assert [summary[each] for each in told] == ["meeting", "ioc", "realtime", "lockstep", 3, "timeout", STEPS]
    assert (summary["refused"], summary["restarts"], summary["deadline_misses"]) == ({}, {}, 0)
    for robot in summary["robots"]:
        assert robot["arrived_s"] is None
        assert 0.0 < robot["driven_m"] < 2.0
    for phase in summary["phases_ms"].values():
        assert 0.0 < phase["p50"] <= phase["p99"] <= phase["max"]


def test_every_message_is_recorded_once_and_none_but_the_minds_tells_of_goals(run):
    messages = recorded(run.out)
    assert Counter(key for key, _ in messages) == {
        "scene": 1,
        "truth": STEPS + 1,
        **{f"{kind}/{robot}": STEPS for kind in ("pose", "command", "mind") for robot in ROBOTS},
    }
    assert len({message.epoch for _, message in messages}) == 1
    assert leaks(messages, {"scene", "pose", "command", "truth"}) == set()


def test_virtual_time_agrees_bit_for_bit(run, scenario, bench):
    virtual = bench("virtual", "simulate", scenario, "--goals", "ioc", "--seed", 3)
    assert virtual.end() == 1, virtual.complained
    assert repeatable(virtual.out) == repeatable(run.out)


def test_exchanged_goals_are_told_by_the_scene_alone_and_another_seed_is_other_noise(run, scenario, bench):
    """This also shows that the search of the other test finds goals where there are any."""
    other = bench("other", "simulate", scenario, "--goals", "exchanged", "--seed", 4)
    assert other.end() == 1, other.complained
    messages = recorded(other.out)
    assert leaks(messages, {"scene"}) == {number for goal in GOALS for number in goal}
    assert leaks(messages, {"pose", "command", "truth"}) == set()
    assert repeatable(other.out)["pose/1", 0] != repeatable(run.out)["pose/1", 0]


def test_every_decision_can_be_repeated(run, process, tmp_path):
    report = audited(process, run.out, tmp_path)
    assert (report["result"], report["verdict"], report["goals_told"]) == ("follows", "timeout", False)
    for kind in ("observations", "minds", "commands"):
        assert numbers(report, kind) == dict.fromkeys(ROBOTS, STEPS)
    replay = process("replay", "replay", run.out / "run.mcap", "--robot", "2", "--steps")
    assert replay.end() == 0, replay.complained
    assert f"All {STEPS} decisions of robot 2 follow" in replay.told
