"""The status of a run without a run: what messages come to, how it is shown, and how it is found."""

import json
import stat

import pytest
from rich.console import Console
from run_helpers import EPOCH, command, mind, truth
from typer.testing import CliRunner

from chassis.refusal import Refusal
from fleet.cli import app
from fleet.run.launch import FILE, Address, left_in
from fleet.status.command import address_of, only_run, shown
from fleet.status.standing import QUIET_S, WINDOW_S, Recent, Spread, Standing
from protocol.messages import PublicScene
from protocol.scene import PublicRobot, Scene

ROBOTS = ("a", "b")
STEP_S = 0.1
ADDRESS = Address(endpoint="tcp/127.0.0.1:7447", run="r", password_file=None)
TIMES = {"decide": 10.0}


def begun(robots=ROBOTS):
    standing = Standing("r")
    scene = Scene(robots=dict.fromkeys(robots, PublicRobot()))
    standing.take(PublicScene(epoch=EPOCH, scene=scene), 0.0)
    return standing


def driven(steps=20, robots=ROBOTS, **of_mind):
    """A run in which everybody answers 30 ms after the truth."""
    standing = begun(robots)
    for robot in robots:
        standing.stands(robot, present=True)
    for step in range(steps):
        standing.take(truth(step, {robot: {"deadline_misses": 2} for robot in robots}), step * STEP_S)
        for robot in robots:
            standing.take(mind(robot, step, timings_ms=TIMES, **of_mind), step * STEP_S + 0.025)
            standing.take(command(robot, step), step * STEP_S + 0.03)
    return standing


def states(standing, now_s=2.0):
    return {robot.robot: robot.state for robot in standing.status(now_s).robots}


def test_before_the_first_step_it_says_who_is_missing():
    standing = begun()
    standing.stands("a", present=True)
    assert states(standing) == {"a": "present", "b": "missing"}
    world = standing.status(0.0).world
    assert (world.state, world.step, world.rate_hz) == ("waits", None, None)


def test_who_decides_is_ready_with_its_rate_its_times_and_its_lag():
    a, b = driven().status(2.0).robots
    assert (a.robot, a.state, a.step, a.missed) == ("a", "ready", 19, 2)
    assert a.rate_hz == pytest.approx(10.0, rel=0.1)
    assert a.decide_ms == Spread(p50=10.0, p99=10.0)
    assert a.lag_ms.p50 == pytest.approx(30.0)
    assert b.state == "ready"


def test_who_does_not_decide_as_it_should_is_degraded_and_whose_token_goes_is_lost_until_it_returns():
    standing = driven(degraded=("gate",))
    [robot, _] = standing.status(2.0).robots
    assert (robot.state, robot.degraded) == ("degraded", ("gate",))
    standing = driven()
    standing.stands("b", present=False)
    assert states(standing) == {"a": "ready", "b": "lost"}
    standing.stands("b", present=True)
    assert states(standing)["b"] == "ready"


def test_who_decides_no_more_is_quiet_unless_the_run_stands_still():
    standing = driven()
    end_s = 2.0 + QUIET_S + 1.0
    for step in range(20, int(end_s / STEP_S)):
        standing.take(truth(step, {"a": {}, "b": {}}), step * STEP_S)
        standing.take(mind("a", step), step * STEP_S + 0.01)
    assert states(standing, end_s) == {"a": "ready", "b": "quiet"}
    still = driven()
    assert still.status(end_s).world.state == "quiet"
    assert states(still, end_s) == {"a": "ready", "b": "ready"}


def test_who_has_arrived_has_and_a_verdict_ends_the_run():
    standing = driven()
    standing.take(truth(20, {"a": {"arrived_s": 1.0}, "b": {}}), 2.0)
    assert states(standing)["a"] == "arrived"
    standing.take(truth(21, {robot: {"arrived_s": 1.0} for robot in ROBOTS}, verdict="arrived"), 2.1)
    world = standing.status(2.1).world
    assert (world.state, world.verdict, world.arrived) == ("ended", "arrived", 2)
    assert standing.verdict == "arrived"


def test_a_new_world_begins_anew():
    standing = driven()
    scene = Scene(robots=dict.fromkeys(ROBOTS, PublicRobot()))
    standing.take(PublicScene(epoch=EPOCH + 1, scene=scene), 3.0)
    assert standing.status(3.0).world.state == "waits"
    assert states(standing, 3.0) == {"a": "present", "b": "present"}


def test_rates_and_times_are_of_the_last_seconds():
    recent = Recent()
    assert recent.rate_hz(0.0) is None
    assert recent.spread(0.0) is None
    for value in range(100):
        recent.add(value * 0.01, float(value))
    assert recent.rate_hz(0.99) == pytest.approx(100.0, rel=0.02)
    assert recent.spread(0.99).p50 == pytest.approx(49.5)
    assert recent.spread(0.985 + WINDOW_S).p50 == 99.0
    assert recent.rate_hz(1.0 + WINDOW_S) is None


def printed(status, width, height=None):
    console = Console(width=width, height=height or 50, no_color=True)
    with console.capture() as capture:
        console.print(shown(status, width, height))
    return capture.get()


@pytest.mark.parametrize("width", [20, 60, 100])
def test_it_fits_every_terminal(width):
    lines = printed(driven(degraded=("gate",)).status(2.0), width).splitlines()
    assert max(map(len, lines)) <= width
    assert any(line.startswith("a ") and "degraded" in line for line in lines)
    assert ("10.0 / 10.0" in "".join(lines)) == (width >= 60)
    assert ("gate" in "".join(lines)) == (width >= 100)


def test_of_many_robots_those_come_first_that_want_to_be_looked_at():
    robots = [f"r{number}" for number in range(40)]
    standing = driven(robots=robots)
    standing.stands("r39", present=False)
    text = printed(standing.status(2.0), 100, height=24)
    lines = text.splitlines()
    assert len(lines) < 24
    assert lines[2].startswith("r39")
    assert "and 22 more: 22 ready" in text
    assert "more" not in printed(standing.status(2.0), 100)


def test_the_address_of_a_run_is_for_its_owner_alone_replaces_an_older_one_and_goes_with_the_run(tmp_path):
    (tmp_path / FILE).write_text("left by a bench that was killed")
    with pytest.raises(Refusal, match="not what a run leaves there"):
        address_of(tmp_path)
    with left_in(tmp_path, ADDRESS):
        assert stat.S_IMODE((tmp_path / FILE).stat().st_mode) == 0o600
        assert address_of(tmp_path) == ADDRESS
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(Refusal, match="this run has ended"):
        address_of(tmp_path)
    with left_in(tmp_path / "nowhere", ADDRESS):
        pass  # a run goes on where its address cannot be left


def test_the_only_run_is_found_and_several_are_named(tmp_path):
    with pytest.raises(Refusal, match="no run is going on in"):
        only_run(tmp_path)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    with left_in(tmp_path / "one", ADDRESS):
        assert only_run(tmp_path) == tmp_path / "one"
        with left_in(tmp_path / "two", ADDRESS), pytest.raises(Refusal, match=r"2 runs .*one, .*two"):
            only_run(tmp_path)


def invoke(*arguments):
    result = CliRunner().invoke(app, ["status", *map(str, arguments)], env={"COLUMNS": "400"})
    assert not isinstance(result.exception, Exception), result.exception
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["nowhere"], 1, "nowhere: there is no such directory"),
        (["--connect", "tcp/127.0.0.1:1"], 3, "there is no world at tcp/127.0.0.1:1"),
        (["--connect", "nonsense"], 3, "nonsense cannot be used"),
        (["--connect", "tcp/127.0.0.1:1", "--password-file", "nothing"], 2, "nothing: cannot be read"),
        (["--connect", "tls/127.0.0.1:1"], 2, "the folder with the keys of this device is expected"),
        (["--connect", "tcp/127.0.0.1:1", "--run", "a/b"], 2, "'a/b' found"),
    ],
)
def test_a_run_that_cannot_be_shown_is_refused(arguments, status, words):
    exit_status, output = invoke(*arguments)
    assert words in output
    assert exit_status == status


def test_a_run_of_which_only_the_way_is_left_has_ended(tmp_path):
    (tmp_path / FILE).write_text(json.dumps(ADDRESS.model_dump() | {"endpoint": "tcp/127.0.0.1:1"}))
    exit_status, output = invoke(tmp_path)
    assert exit_status == 1
    assert "its bench was ended without being able to say so" in output
