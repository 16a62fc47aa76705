"""Worlds and robots started by hand, as on several machines, also in different versions of the protocol."""

import re
import signal
import socket
import sys

import pytest
from process_helpers import FAR_SIGHTED, lanes, write_scenario

from protocol.identity import new_passwords, write_password, write_users

ROBOT = ("agent", "--robot", 1, "--goal", "0.5,0,0")
NEWER = (
    sys.executable,
    "-c",
    "import protocol.version; protocol.version.PROTOCOL_VERSION = 2; from fleet.entry import main; main()",
)
"""``unspoken`` as of the next version."""
OLD_WORLD = "robot 1 speaks version 2 of the protocol, the world version 1; update the software of the world"
OLD_ROBOT = "robot 1 speaks version 1 of the protocol, the world version 2; update the software of robot 1"


@pytest.fixture
def port():
    """A TCP port that is free."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.fixture
def scenario(tmp_path):
    return write_scenario(tmp_path / "lanes.yaml", lanes(2, 0.5), horizons=FAR_SIGHTED)


def test_robots_come_first_and_serve_one_world_after_the_other(process, port, scenario):
    endpoint = f"tcp/127.0.0.1:{port}"
    one = process("one", *ROBOT, "--connect", endpoint, "--run", "hall")
    told = {"ROBOT": 2, "GOAL": "0.5,2,0", "CONNECT": endpoint, "RUN": "hall", "GOALS": "ioc"}
    two = process("two", "agent", env={f"UNSPOKEN_{name}": value for name, value in told.items()})
    for robot in (one, two):
        robot.tells("waiting for the world")
        assert f"connect={endpoint}" in robot.told
        assert "run=hall" in robot.told
        robot.tells("ready to decide")
    endings = []
    for name in ("first", "second"):
        world = process(name, "world", "--scenario", scenario, "--listen", endpoint, "--run", "hall")
        assert world.end() == 0, world.told + world.complained
        [epoch] = re.findall(r"world started .*epoch=(\d+)", world.told)
        for robot in (one, two):
            assert re.findall(r"joined .*epoch=(\d+)", robot.told)[-1] == epoch
        endings += re.findall(r"run ended .*(step=\d+).*(verdict=\w+)", world.told)
    assert len(endings) == 2
    assert endings[0] == endings[1]
    for robot in (one, two):
        assert robot.running
        robot.signal(signal.SIGTERM)
        assert robot.end() == 0
        assert robot.complained == ""
        assert len(set(re.findall(r"joined .*epoch=(\d+)", robot.told))) == 2


def test_robots_that_do_not_fit_the_world_say_why(process, endpoint, scenario):
    world = process("world", "world", "--scenario", scenario, "--listen", endpoint)
    world.tells("waiting for robots")
    options = ("agent", "--goal", "0.5,0,0", "--connect", endpoint, "--robot")
    stranger = process("stranger", *options, 7)
    curious = process("curious", *options, 1, env={"UNSPOKEN_GOALS": "exchanged"})
    assert (stranger.end(), curious.end()) == (3, 3)
    assert "this world has no robot '7'; its robots are 1, 2" in stranger.complained
    assert "goals" in curious.complained
    for robot in (stranger, curious):
        assert len(robot.complained.splitlines()) == 1
    world.signal(signal.SIGTERM)
    assert world.end() == 1
    assert "all robots present" not in world.told


@pytest.mark.parametrize(
    ("arguments", "status", "told"),
    [
        (("--connect", "the hall"), 3, "robot 1: the endpoint the hall cannot be used"),
        (("--password-file", "none"), 2, "cannot be read: No such file"),
        (("--keys", "."), 2, "an endpoint such as tls/world.local:7447 is expected with --keys"),
    ],
)
def test_a_robot_that_cannot_begin_says_why(process, arguments, status, told):
    robot = process("one", *ROBOT, *arguments)
    assert robot.end() == status
    assert told in robot.complained
    for trace in ("Traceback", ".rs"):
        assert trace not in robot.complained


def test_a_newer_robot_and_a_world_with_a_policy_refuse_each_other(process, endpoint, scenario, tmp_path):
    passwords = new_passwords(["1", "2", "@bench"])
    write_users(tmp_path / "users", passwords)
    write_password(tmp_path / "one", passwords["1"])
    options = ("--scenario", scenario, "--listen", endpoint, "--users", tmp_path / "users")
    world = process("world", "world", *options)
    world.tells("waiting for robots")
    told = (*ROBOT, "--connect", endpoint, "--password-file", tmp_path / "one")
    robot = process("robot", *told, program=NEWER)
    assert robot.end() == 3
    assert robot.complained == f"robot 1: {OLD_WORLD}\n"
    world.tells(OLD_WORLD)
    world.signal(signal.SIGTERM)
    assert world.end() == 1
    assert world.told.count("version 2 of the protocol") == 1
    assert world.complained == ""


@pytest.mark.slow
def test_a_robot_whose_world_comes_back_in_a_newer_version_ends(process, endpoint, tmp_path):
    alone = write_scenario(tmp_path / "alone.yaml", lanes(1, 9.0, limits={"speed_mps": 0.5}))
    options = ("world", "--scenario", alone, "--listen", endpoint)
    robot = process("robot", *ROBOT, "--connect", endpoint)
    with process("first", *options) as first:
        first.tells("all robots present")
        robot.tells("joined")
        first.signal(signal.SIGTERM)
        first.end()
    second = process("second", *options, program=NEWER)
    second.tells(OLD_ROBOT)
    assert robot.end() == 3
    assert robot.complained == f"robot 1: {OLD_ROBOT}\n"
