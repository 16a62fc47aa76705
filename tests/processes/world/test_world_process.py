"""The world as a real process, with scripted robots on real sessions."""

import signal
import socket
import sys

import pytest
import zenoh
from process_helpers import Process, Truths
from world_helpers import KEYS, PATIENCE_S, SPRINT_STEPS, command, lanes, sprint

from protocol.codec import decode, encode
from protocol.messages import Observation
from protocol.scenario import Sensing, scenario_text
from protocol.session import client_session
from world.world import World


def connect(endpoint):
    """A client's session that gives up when no world comes: a failing test must not hang."""
    return zenoh.open(client_session(endpoint, patience_s=PATIENCE_S).to_zenoh())


class Robot:
    """Answers every observation with its sprint. `before` and `silent_from` make it misbehave."""

    def __init__(self, endpoint, name, *, silent_from=None, before=lambda session, seen: None):
        self.name = name
        self.seen = []
        self._silent_from = silent_from
        self._before = before
        self.session = connect(endpoint)
        self._commands = self.session.declare_publisher(KEYS.command(name))
        self._poses = self.session.declare_subscriber(KEYS.pose(name), self._answer)
        self._token = self.session.liveliness().declare_token(KEYS.alive(name))

    def _answer(self, sample):
        seen = decode(Observation, sample.payload.to_bytes())
        self.seen.append(seen)
        self._before(self.session, seen)
        if self._silent_from is None or seen.step < self._silent_from:
            answer = command(self.name, seen.step, sprint(seen.step), epoch=seen.epoch)
            self._commands.put(encode(answer))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()


@pytest.fixture
def start(tmp_path, endpoint, process):
    """Start a world on a scenario."""

    def start_world(scenario, *arguments, **env) -> Process:
        path = tmp_path / "scenario.yaml"
        path.write_text(scenario_text(scenario))
        told = {"UNSPOKEN_SCENARIO": path, "UNSPOKEN_LISTEN": endpoint, **env}
        return process("world", *arguments, env=told, program=(sys.executable, "-m", "world"))

    return start_world


def test_two_robots_drive_to_the_verdict_and_every_truth_is_delivered(start, endpoint):
    scenario = lanes(2, sensing=Sensing(position_noise_m=0.1))
    world = start(scenario, "--seed", "12")
    with Truths(connect(endpoint), KEYS) as bench, Robot(endpoint, "1") as one, Robot(endpoint, "2") as two:
        last = bench.ended()
        assert world.end() == 0
        assert world.complained == ""
        assert [truth.step for truth in bench.all] == list(range(SPRINT_STEPS + 1))
        assert [truth.verdict for truth in bench.all[:-1]] == [None] * SPRINT_STEPS
        for robot in (one, two):
            assert [seen.step for seen in robot.seen] == list(range(SPRINT_STEPS))
        assert len({message.epoch for message in (*bench.all, *one.seen, *two.seen)}) == 1
    assert last.verdict == "arrived"
    assert {robot: true.arrived_s for robot, true in last.robots.items()} == pytest.approx(
        {"1": 2.0, "2": 2.0}
    )
    assert sum(robot.deadline_misses for robot in last.robots.values()) == 0
    first = World(scenario, seed=12, epoch=last.epoch).observations()
    assert (one.seen[0], two.seen[0]) == (first["1"], first["2"]), "the seed reaches the sensors"
    assert "all robots present" in world.told
    assert "verdict=arrived" in world.told


def spoil(session, seen):
    """What a faulty or malicious robot might put before the honest answer comes."""
    session.put(KEYS.command("1"), b"\xc1 garbage")
    session.put(KEYS.command("2"), encode(command("1", seen.step, 3.0, epoch=seen.epoch)))
    session.put(KEYS.command("1"), encode(command("1", seen.step + 1, 3.0, epoch=seen.epoch)))
    session.put(KEYS.command("1"), encode(command("1", seen.step, 3.0, epoch=(seen.epoch + 1) % 2**63)))
    session.delete(KEYS.command("1"))


def test_garbage_and_misattributed_commands_are_refused_and_leave_the_run_as_it_is(start, endpoint):
    world = start(lanes(2))
    with Truths(connect(endpoint), KEYS) as bench, Robot(endpoint, "1", before=spoil), Robot(endpoint, "2"):
        bench.ended()
        assert world.end() == 0
    core = World(lanes(2), seed=0, epoch=bench.all[0].epoch)
    for truth in bench.all:
        assert truth.model_copy(update={"refused": {}}) == core.truth()
        if not core.over:
            acceleration = sprint(core.step)
            core.advance({r: command(r, core.step, acceleration, epoch=truth.epoch) for r in core.robots})
    assert core.over
    refused = bench.all[-1].refused
    least = {
        ("1", "not a valid message"): 2 * (SPRINT_STEPS - 1),  # garbage, and the deletion
        ("1", "answers another step"): SPRINT_STEPS - 1,
        ("1", "answers another epoch"): SPRINT_STEPS - 1,
        ("2", "names another robot"): SPRINT_STEPS - 1,
    }
    for (robot, reason), number in least.items():
        assert refused[robot][reason] >= number
        logged = [line for line in world.told.splitlines() if "command refused" in line and reason in line]
        assert len(logged) == 1, (reason, world.told)


def test_a_signal_while_waiting_for_a_command_interrupts_the_run(start, endpoint):
    world = start(lanes(2))
    with Truths(connect(endpoint), KEYS) as bench, Robot(endpoint, "1"), Robot(endpoint, "2", silent_from=5):
        bench.reached(5)
        world.signal(signal.SIGTERM)
        bench.ended()
        assert world.end() == 1
    assert world.complained == ""
    assert [truth.step for truth in bench.all] == [0, 1, 2, 3, 4, 5, 5]
    assert [truth.verdict for truth in bench.all] == [None] * 6 + ["interrupted"]


@pytest.mark.parametrize(
    ("arguments", "status", "told"),
    [
        (
            ("--listen", "tcp/127.0.0.1:{port}"),
            3,
            "the endpoint tcp/127.0.0.1:{port} cannot be opened",
        ),
        (("--listen", "tcp/0.0.0.0:7447"), 2, "say --insecure"),
        (("--users", "/nowhere/users"), 2, "/nowhere/users: cannot be read"),
        (("--listen", "tls/0.0.0.0:7447"), 2, "'unspoken keys create'"),
    ],
)
def test_a_world_that_cannot_be_opened_says_why(start, arguments, status, told):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        world = start(lanes(1), *(each.format(port=port) for each in arguments))
        assert world.end() == status
    assert told.format(port=port) in world.complained
    for trace in ("Traceback", ".rs"):
        assert trace not in world.complained


def test_every_option_can_come_from_the_environment_and_missing_robots_are_named(start, endpoint):
    told = {
        "RUN": "evening",
        "CLOCK": "realtime",
        "SEED": 5,
        "EXCHANGE_GOALS": 1,
        "START_TIMEOUT": 0.25,
        "ANSWER_TIMEOUT": 3,
    }
    world = start(lanes(2), **{f"UNSPOKEN_{name}": value for name, value in told.items()})
    assert world.end() == 3
    assert "0.25 s" in world.complained
    assert "missing: 1, 2. Step 0 was not published" in world.complained
    assert "Traceback" not in world.complained
    for text in ("run=evening", "clock=realtime", "seed=5", "exchange_goals=True", f"listen={endpoint}"):
        assert text in world.told
