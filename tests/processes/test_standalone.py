"""Worlds and robots started by hand, as on several machines."""

import re
import signal
import socket

import pytest
from process_helpers import lanes, write_scenario


@pytest.fixture
def endpoint():
    """A TCP endpoint that is free."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    return f"tcp/127.0.0.1:{port}"


@pytest.fixture
def scenario(tmp_path):
    return write_scenario(
        tmp_path / "lanes.yaml", lanes(2, 0.5), horizons={"prediction_steps": 12, "estimation_steps": 3}
    )


def found(pattern, text):
    return re.findall(pattern, text)


def test_robots_come_first_and_serve_one_world_after_the_other(process, endpoint, scenario):
    one = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", "--connect", endpoint, "--run", "hall")
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
        [epoch] = found(r"world started .*epoch=(\d+)", world.told)
        for robot in (one, two):
            assert found(r"joined .*epoch=(\d+)", robot.told)[-1] == epoch
        endings += found(r"run ended .*(step=\d+).*(verdict=\w+)", world.told)
    assert len(endings) == 2
    assert endings[0] == endings[1]
    for robot in (one, two):
        assert robot.running
        robot.signal(signal.SIGTERM)
        assert robot.end() == 0
        assert robot.complained == ""
        assert len(set(found(r"joined .*epoch=(\d+)", robot.told))) == 2


def test_a_robot_that_does_not_come_is_named(process, endpoint, scenario):
    robot = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", "--connect", endpoint)
    robot.tells("waiting for the world")
    world = process("world", "world", "--scenario", scenario, "--listen", endpoint, "--start-timeout", 5)
    assert world.end() == 3
    assert "missing: 2." in world.complained
    assert "Traceback" not in world.complained


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_robot_that_waits_for_a_world_can_be_ended(process, endpoint, number):
    robot = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", "--connect", endpoint)
    robot.tells("waiting for the world")
    robot.signal(number)
    assert robot.end() == 0
    assert robot.complained == ""


def test_robots_that_do_not_fit_the_world_say_why(process, endpoint, scenario):
    world = process("world", "world", "--scenario", scenario, "--listen", endpoint)
    world.tells("waiting for robots")
    options = ("--goal", "0.5,0,0", "--connect", endpoint)
    stranger = process("stranger", "agent", "--robot", 7, *options)
    curious = process("curious", "agent", "--robot", 1, *options, env={"UNSPOKEN_GOALS": "exchanged"})
    assert (stranger.end(), curious.end()) == (3, 3)
    assert "this world has no robot '7'; its robots are 1, 2" in stranger.complained
    assert "goals" in curious.complained
    for robot in (stranger, curious):
        assert len(robot.complained.splitlines()) == 1
    world.signal(signal.SIGTERM)
    assert world.end() == 1
    assert "all robots present" not in world.told


def test_an_endpoint_that_is_none_is_a_clear_error(process):
    robot = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", "--connect", "the hall")
    assert robot.end() == 3
    assert "robot 1: the endpoint the hall cannot be used" in robot.complained
    assert "--connect" in robot.complained
    assert "Traceback" not in robot.complained
    assert ".rs" not in robot.complained
