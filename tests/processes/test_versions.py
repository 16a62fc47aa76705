"""Robots and worlds of different versions of the protocol, as during an update."""

import signal
import sys

import pytest
from process_helpers import lanes, write_scenario

from protocol.identity import new_passwords, write_password, write_users

NEWER = (
    sys.executable,
    "-c",
    "import protocol.version; protocol.version.PROTOCOL_VERSION = 2; from fleet.entry import main; main()",
)
"""``unspoken`` as of the next version."""
OLD_WORLD = "robot 1 speaks version 2 of the protocol, the world version 1; update the software of the world"
OLD_ROBOT = "robot 1 speaks version 1 of the protocol, the world version 2; update the software of robot 1"


@pytest.fixture
def scenario(tmp_path):
    return write_scenario(tmp_path / "lanes.yaml", lanes(2, 9.0, limits={"speed_mps": 0.5}))


def test_a_newer_robot_and_a_world_with_a_policy_refuse_each_other(process, endpoint, scenario, tmp_path):
    passwords = new_passwords(["1", "2", "@bench"])
    write_users(tmp_path / "users", passwords)
    write_password(tmp_path / "one", passwords["1"])
    options = ("--scenario", scenario, "--listen", endpoint, "--users", tmp_path / "users")
    world = process("world", "world", *options, "--start-timeout", 60)
    world.tells("waiting for robots")
    told = ("--goal", "9,0,0", "--connect", endpoint, "--password-file", tmp_path / "one")
    robot = process("robot", "agent", "--robot", 1, *told, program=NEWER)
    assert robot.end() == 3
    assert robot.complained == f"robot 1: {OLD_WORLD}\n"
    world.tells(OLD_WORLD)
    world.signal(signal.SIGTERM)
    assert world.end() == 1
    assert world.told.count("version 2 of the protocol") == 1
    assert world.complained == ""


@pytest.mark.slow
def test_a_world_that_waits_in_vain_names_the_version_of_a_robot(process, endpoint, scenario):
    world = process("world", "world", "--scenario", scenario, "--listen", endpoint, "--start-timeout", 20)
    world.tells("waiting for robots")
    told = ("--robot", 1, "--goal", "9,0,0", "--connect", endpoint)
    assert process("robot", "agent", *told, program=NEWER).end() == 3
    assert world.end() == 3
    assert "missing: 1, 2." in world.complained
    assert f" R{OLD_WORLD[1:]}." in world.complained
    assert len(world.complained.splitlines()) == 1


def test_a_robot_whose_world_comes_back_in_a_newer_version_ends(process, endpoint, tmp_path):
    alone = write_scenario(tmp_path / "alone.yaml", lanes(1, 9.0, limits={"speed_mps": 0.5}))
    options = ("world", "--scenario", alone, "--listen", endpoint)
    robot = process("robot", "agent", "--robot", 1, "--goal", "9,0,0", "--connect", endpoint)
    with process("first", *options) as first:
        first.tells("all robots present")
        robot.tells("joined")
        first.signal(signal.SIGTERM)
        first.end()
    second = process("second", *options, program=NEWER)
    second.tells(OLD_ROBOT)
    assert robot.end() == 3
    assert robot.complained == f"robot 1: {OLD_ROBOT}\n"
