"""The bridge to ROS 2 and real agents, with robots that obey twists on the other side."""

import math
import signal
from queue import SimpleQueue

import pytest
import yaml
import zenoh
from process_helpers import PATIENCE_S, until
from ros2_helpers import bridge_file
from ros2_side import Base, RosSide

from protocol.codec import decode
from protocol.keys import Keys
from protocol.messages import Observation, Truth
from protocol.session import client_session

KEYS = Keys("run")
ROBOT = {"radius_m": 0.4, "limits": {"speed_mps": 1.5, "acceleration_mps2": 2.0}}
ACCURACY = {"position_m": 0.005, "heading_rad": 0.005, "speed_mps": 0.02}


@pytest.fixture
def places(temporary):
    """Endpoints for the agents and for the side of ROS."""
    return f"unixsock-stream/{temporary}/a", f"unixsock-stream/{temporary}/r"


@pytest.fixture
def bridge(process, places, tmp_path):
    """Start a bridge between robots and agents."""
    agents_at, ros_at = places

    def start(bases, *arguments, **rules):
        content = bridge_file(len(bases), robot=ROBOT, unstated_accuracy=ACCURACY, connect=ros_at, **rules)
        for robot, base in zip(content["robots"], bases, strict=True):
            x_m, y_m, heading_rad = base.origin
            robot["origin"] = {"x_m": x_m, "y_m": y_m, "heading_rad": heading_rad}
        path = tmp_path / "bridge.yaml"
        path.write_text(yaml.safe_dump(content))
        return process("bridge", "bridge", "ros2", path, "--listen", agents_at, *arguments)

    return start


@pytest.fixture
def agents(process, places):
    """Start an agent for each goal."""

    def start(goals, *arguments):
        return [
            process(
                f"agent-{robot}",
                "agent",
                *("--robot", robot, "--connect", places[0], "--budget-ms", 50, *arguments),
                env={"UNSPOKEN_GOAL": ",".join(map(str, goal))},
            )
            for robot, goal in goals.items()
        ]

    return start


def star(count, distance_m=3.0):
    """Robots on a circle that look to its centre, and their goals opposite."""
    bases, goals = [], {}
    for index in range(count):
        angle = math.tau * index / count
        x_m, y_m, heading = distance_m * math.cos(angle), distance_m * math.sin(angle), angle + math.pi
        own = {"clock_off_s": 1e6 * index, "little_endian": index % 2 == 0}
        origin = (x_m, y_m, heading + 0.5 * index)
        bases.append(Base(str(index + 1), x_m, y_m, heading, origin, **own))
        goals[str(index + 1)] = (-x_m, -y_m, math.remainder(heading, math.tau))
    return bases, goals


def ends(bridge, number=signal.SIGINT):
    bridge.signal(number)
    assert bridge.end() == 0, bridge.told + bridge.complained
    assert bridge.complained == ""


def drives(base, speed_mps=0.5):
    until(lambda: base.speed_mps > speed_mps, "a robot that drives")


@pytest.mark.slow
def test_robots_cross_without_collision_and_stop_where_they_wanted(bridge, agents, places):
    bases, goals = star(3)
    with RosSide(places[1], bases) as ros:
        crossing = bridge(bases)
        started = agents(goals)

        def arrived():
            return all(
                math.dist((base.x_m, base.y_m), goals[base.name][:2]) < 0.15 and abs(base.speed_mps) < 0.05
                for base in bases
            )

        until(arrived, "the arrival of all robots")
        assert ros.minimum_distance_m > 0.8
        assert all(max(speed for speed, _ in base.told) > 1.0 for base in bases)
        ends(crossing)
        until(lambda: all(base.told[-1] == (0.0, 0.0) for base in bases), "the last twist")
    assert "refused_odometry={}" in crossing.told
    assert all(agent.running for agent in started)


@pytest.mark.slow
def test_a_robot_whose_odometry_is_garbage_is_not_harmed_and_one_whose_stops_is_stopped_and_not_seen(
    bridge, agents, places
):
    bases, goals = star(3, distance_m=8.0)
    poses, truths = SimpleQueue(), SimpleQueue()
    with RosSide(places[1], bases) as ros:
        crossing = bridge(bases)
        crossing.tells("waiting for robots")
        with zenoh.open(client_session(places[0]).to_zenoh()) as listening:
            _poses = listening.declare_subscriber(
                KEYS.pose("1"), lambda sample: poses.put(decode(Observation, sample.payload.to_bytes()))
            )
            _truths = listening.declare_subscriber(
                KEYS.truth, lambda sample: truths.put(decode(Truth, sample.payload.to_bytes()))
            )
            agents(goals)
            blind = ros.bases["2"]
            crossing.tells("all robots present")
            for payload in (b"", b"garbage", b"\x00\x01\x00\x00", bytes(740), b"\xff" * 2000):
                ros.put("2", payload)
            crossing.tells("odometry refused")
            drives(blind)
            drain(poses, {"1", "2", "3"})
            blind.sends = False
            crossing.tells("odometry lost: the robot is stopped")
            until(lambda: blind.told[-1] == (0.0, 0.0) and blind.speed_mps == 0.0, "a stop")
            for told in (poses, truths):
                drain(told, {"1", "3"})
                assert all(set(told.get(timeout=PATIENCE_S).robots) == {"1", "3"} for _ in range(5))
            blind.sends = True
            until(lambda: crossing.told.count("odometry found") == 4, "its return")
            drain(poses, {"1", "2", "3"})
            drives(blind)
        ends(crossing, signal.SIGTERM)
    assert crossing.told.count("odometry refused") == 1
    assert "'not an Odometry message': 5" in crossing.told
    assert "Traceback" not in crossing.told


def drain(told, robots):
    """Wait for a message that tells of these robots and no others."""
    while set(told.get(timeout=PATIENCE_S).robots) != robots:
        pass


@pytest.mark.slow
def test_a_robot_whose_agent_hangs_brakes_and_the_side_of_ros_may_go_and_come_back(bridge, agents, places):
    bases, goals = star(2, distance_m=8.0)
    with RosSide(places[1], bases):
        crossing = bridge(bases)
        hung, _ = agents(goals)
        drives(bases[0], 0.8)
        hung.signal(signal.SIGSTOP)
        until(lambda: bases[0].speed_mps < 0.01, "its stop")
        hung.signal(signal.SIGCONT)
        drives(bases[0], 0.8)
    until(lambda: crossing.told.count("odometry lost") >= 2, "the loss of both")
    for base in bases:
        base.speed_mps, base.told = 0.0, []
    found = crossing.told.count("odometry found")
    with RosSide(places[1], bases):
        until(lambda: crossing.told.count("odometry found") == found + 2, "the return of both")
        drives(bases[0])
        ends(crossing)


def test_the_command_without_agents_or_without_ros_says_what_is_missing(bridge, places):
    bases, _ = star(2)
    waiting = bridge(bases)
    waiting.tells("waiting for the side of ROS")
    ends(waiting)
    with RosSide(places[1], bases) as ros:
        alone = bridge(bases, "--start-timeout", 1)
        assert alone.end() == 3
        assert "missing: 1, 2." in alone.complained
        assert "Traceback" not in alone.complained
        until(lambda: ros.bases["1"].told == [(0.0, 0.0)], "a twist that stops")
