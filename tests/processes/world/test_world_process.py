"""The world as a real process, with scripted robots on real sessions."""

import os
import signal
import socket
import threading

import pytest
from world_helpers import KEYS, PATIENCE_S, SPRINT_STEPS, command, lanes, sprint
from world_processes import Robot, TruthRecorder, WorldProcess, connect, write_scenario

from protocol.codec import decode, encode
from protocol.messages import PublicScene
from protocol.scenario import Sensing
from world.world import World


@pytest.fixture
def start(tmp_path, endpoint):
    """Start a world on a scenario; it is ended at the latest with the test."""
    worlds = []

    def start_world(scenario, *arguments):
        path = write_scenario(tmp_path / "scenario.yaml", scenario)
        worlds.append(WorldProcess("--scenario", path, "--listen", endpoint, *arguments))
        return worlds[-1]

    yield start_world
    for world in worlds:
        world.__exit__()


def test_two_robots_drive_to_the_verdict_and_every_truth_is_delivered(start, endpoint):
    world = start(lanes(2))
    with TruthRecorder(endpoint) as bench, Robot(endpoint, "1") as one, Robot(endpoint, "2") as two:
        last = bench.ended()
        assert world.end() == (0, "")
        assert [truth.step for truth in bench.truths] == list(range(SPRINT_STEPS + 1))
        assert [truth.verdict for truth in bench.truths[:-1]] == [None] * SPRINT_STEPS
        assert (
            [seen.step for seen in one.seen] == [seen.step for seen in two.seen] == list(range(SPRINT_STEPS))
        )
        assert len({message.epoch for message in (*bench.truths, *one.seen, *two.seen)}) == 1
    assert last.verdict == "arrived"
    assert {robot: true.arrived_s for robot, true in last.robots.items()} == pytest.approx(
        {"1": 2.0, "2": 2.0}
    )
    assert sum(robot.deadline_misses for robot in last.robots.values()) == 0
    assert "all robots present" in world.log
    assert "verdict=arrived" in world.log


def spoil(session, seen):
    """What a faulty or malicious robot might put before the honest answer comes."""
    session.put(KEYS.command("1"), b"\xc1 garbage")
    session.put(KEYS.command("2"), encode(command("1", seen.step, 3.0, epoch=seen.epoch)))
    session.put(KEYS.command("1"), encode(command("1", seen.step + 1, 3.0, epoch=seen.epoch)))
    session.put(KEYS.command("1"), encode(command("1", seen.step, 3.0, epoch=(seen.epoch + 1) % 2**63)))
    session.delete(KEYS.command("1"))


def test_garbage_and_misattributed_commands_are_refused_and_leave_the_run_as_it_is(start, endpoint):
    world = start(lanes(2))
    with TruthRecorder(endpoint) as bench, Robot(endpoint, "1", before=spoil), Robot(endpoint, "2"):
        bench.ended()
        assert world.end()[0] == 0
    core = World(lanes(2), seed=0, epoch=bench.truths[0].epoch)
    for truth in bench.truths:
        assert truth.model_copy(update={"refused": {}}) == core.truth()
        if not core.over:
            core.advance(
                {
                    robot: command(robot, core.step, sprint(core.step), epoch=truth.epoch)
                    for robot in core.robots
                }
            )
    assert core.over
    refused_of_1 = bench.truths[-1].refused["1"]
    assert refused_of_1.pop("not a valid message") >= 2 * (SPRINT_STEPS - 1)  # garbage, and the deletion
    for reason in ("answers another step", "answers another epoch"):
        assert refused_of_1[reason] >= SPRINT_STEPS - 1
    assert bench.truths[-1].refused["2"]["names another robot"] >= SPRINT_STEPS - 1
    for reason in (
        "not a valid message",
        "names another robot",
        "answers another step",
        "answers another epoch",
    ):
        refused = [
            line for line in world.log.splitlines() if "command refused" in line and f"'{reason}'" in line
        ]
        assert len(refused) == 1, (reason, world.log)


def test_missing_robots_are_named(start):
    world = start(lanes(2), "--start-timeout", "0.2")
    status, told = world.end()
    assert status == 3
    assert "missing: 1, 2. Step 0 was not published" in told
    assert "Traceback" not in told


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_the_barrier_interrupts_the_run(start, endpoint, number):
    world = start(lanes(2))
    with TruthRecorder(endpoint) as bench, Robot(endpoint, "1"):
        world.wait_for("missing=2")
        world.signal(number)
        last = bench.ended()
        assert world.end() == (1, "")
    assert (last.step, last.verdict) == (0, "interrupted")
    assert len(bench.truths) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_waiting_for_a_command_interrupts_the_run(start, endpoint, number):
    world = start(lanes(2))
    with TruthRecorder(endpoint) as bench, Robot(endpoint, "1"), Robot(endpoint, "2", silent_from=5):
        bench.reached(5)
        world.signal(number)
        bench.ended()
        assert world.end() == (1, "")
    assert [truth.step for truth in bench.truths] == [0, 1, 2, 3, 4, 5, 5]
    assert [truth.verdict for truth in bench.truths] == [None] * 6 + ["interrupted"]


@pytest.mark.parametrize("exchange_goals", [False, True])
def test_the_scene_tells_everything_but_the_goals_unless_asked_to(start, endpoint, exchange_goals):
    scenario = lanes(2, safety_margin_m=0.3)
    world = start(scenario, *["--exchange-goals"] * exchange_goals)
    world.wait_for("waiting for robots")
    with connect(endpoint) as session:
        (reply,) = session.get(KEYS.scene)
    scene = decode(PublicScene, reply.ok.payload.to_bytes()).scene
    assert scene == scenario.scene(with_goals=exchange_goals)
    assert (scene.goals is not None) is exchange_goals


def test_a_robot_that_comes_before_the_world_waits_for_it(start, endpoint):
    robots = []
    early = threading.Thread(target=lambda: robots.append(Robot(endpoint, "1")), daemon=True)
    early.start()
    world = start(lanes(1))
    early.join(PATIENCE_S)
    with robots[0]:
        assert world.end()[0] == 0
        assert [seen.step for seen in robots[0].seen] == list(range(SPRINT_STEPS))


def test_a_seed_given_to_the_process_reaches_the_sensors(start, endpoint):
    scenario = lanes(1, sensing=Sensing(position_noise_m=0.1))
    world = start(scenario, "--seed", "12")
    with Robot(endpoint, "1") as robot:
        assert world.end()[0] == 0
    first = robot.seen[0]
    assert first == World(scenario, seed=12, epoch=first.epoch).observations()["1"]


def test_a_port_in_use_is_a_clear_error(tmp_path):
    path = write_scenario(tmp_path / "scenario.yaml", lanes(1))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with WorldProcess("--scenario", path, "--listen", listen) as world:
            status, told = world.end()
    assert status == 3
    assert f"the endpoint {listen} cannot be opened" in told
    assert "Address already in use" in told
    assert "--listen" in told
    assert "Traceback" not in told
    assert ".rs" not in told


def test_every_option_can_come_from_the_environment(tmp_path, endpoint):
    told = {
        "UNSPOKEN_SCENARIO": write_scenario(tmp_path / "scenario.yaml", lanes(2)),
        "UNSPOKEN_LISTEN": endpoint,
        "UNSPOKEN_RUN": "evening",
        "UNSPOKEN_CLOCK": "realtime",
        "UNSPOKEN_SEED": 5,
        "UNSPOKEN_EXCHANGE_GOALS": 1,
        "UNSPOKEN_START_TIMEOUT": 0.25,
        "UNSPOKEN_ANSWER_TIMEOUT": 3,
    }
    with WorldProcess(env=os.environ | {name: str(value) for name, value in told.items()}) as world:
        status, told_error = world.end()
    assert status == 3
    assert "0.25 s" in told_error
    for text in ("run=evening", "clock=realtime", "seed=5", "exchange_goals=True", f"listen={endpoint}"):
        assert text in world.log


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--listen", "tcp/0.0.0.0:7447"), "say --insecure"),
        (("--listen", "tcp/127.0.0.1:7447", "--users", "/nowhere/users"), "/nowhere/users: cannot be read"),
        (("--listen", "tls/0.0.0.0:7447"), "'unspoken keys create'"),
    ],
)
def test_wrong_access_is_wrong_usage_without_a_traceback(tmp_path, arguments, told):
    path = write_scenario(tmp_path / "scenario.yaml", lanes(2))
    with WorldProcess("--scenario", path, *arguments) as world:
        status, complained = world.end()
    assert status == 2
    assert told in complained
    assert "Traceback" not in complained
