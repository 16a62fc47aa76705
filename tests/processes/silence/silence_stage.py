"""A whole run in one process for cheats to try themselves on: the real router, its policy, honest robots."""

import json
import secrets
import shutil
import tempfile
import threading
from collections.abc import Callable, Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import structlog
import zenoh

from protocol.codec import MessageError, decode, encode
from protocol.identity import Login, new_passwords, write_users
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import Command, Observation, PublicScene, Truth
from protocol.scenario import Pose, Scenario, ScenarioRobot
from protocol.scene import Area
from protocol.session import SessionSettings, client_session, world_session
from world.access import Access
from world.bus import Bus, Inbox
from world.clock import LockStep
from world.run import Run
from world.world import World

PATIENCE_S = 30.0
"""How long is waited for what should come; only reached when a test fails."""
QUIET_STEPS = 30
"""Whatever leaks is there after so many rounds of honest messages over the same sockets."""
KEYS = Keys("run")
ROBOTS = ("1", "2", "3")
"""Robots 1 and 2 collude; 3 knows of nothing."""
EPOCH = 7
MARK = b"psst-1-wants-to-go-left"


def lanes() -> Scenario:
    """Ways side by side that take longer than any test."""
    robots = [
        ScenarioRobot(id=robot, start=Pose(x_m=0.0, y_m=2.0 * y), goal=Pose(x_m=9e5, y_m=2.0 * y))
        for y, robot in enumerate(ROBOTS)
    ]
    return Scenario(name="lanes", robots=robots, area=Area(x_max_m=1e6), time_limit_s=1e5)


def honest(robot: str, step: int, epoch: int = EPOCH) -> Command:
    """What an honest robot answers: it speeds up and goes on."""
    return Command(
        epoch=epoch,
        robot=robot,
        step=step,
        turn_rate_radps=0.0,
        acceleration_mps2=1.0 if step < 10 else 0.0,
    )


def open_settings(endpoint: str) -> SessionSettings:
    """A router as one has it without this project: it lets everybody do everything, and gossips."""
    return world_session(endpoint)


class Evidence:
    """What has got through that should not; filled by callbacks."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.found: list[Any] = []

    def add(self, what: Any) -> None:
        with self._changed:
            self.found.append(what)
            self._changed.notify_all()

    def comes(self, all_of: Collection[str] = ()) -> bool:
        """Wait for some, or for all of these."""

        def is_there() -> bool:
            return bool(self.found) and set(all_of) <= {each for each in self.found if isinstance(each, str)}

        with self._changed:
            return self._changed.wait_for(is_there, PATIENCE_S)


class HonestRobot:
    """Reads its poses, answers each, thinks aloud to the bench; keeps all that reaches it."""

    def __init__(self, stage: "Stage", robot: str) -> None:
        self.robot = robot
        self.got: list[tuple[str, bytes]] = []
        self.session = stage.connect(robot)
        self._using, self._left = threading.Lock(), False
        self._subscriber = self.session.declare_subscriber(KEYS.pose(robot), self._answer)
        self._token = self.session.liveliness().declare_token(KEYS.alive(robot))

    def _answer(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        self.got.append((str(sample.key_expr), payload))
        try:
            step = decode(Observation, payload).step
        except MessageError:
            return  # a forged pose; the test looks for it in what was got
        with self._using:
            if not self._left:
                self.session.put(KEYS.mind(self.robot), b"a thought")
                self.session.put(KEYS.command(self.robot), encode(honest(self.robot, step)))

    def leave(self) -> None:
        """Answer no more; a session cannot be closed while it is being used."""
        with self._using:
            self._left = True


class Stage:
    """The world's router with a run on it, three honest robots and a listening bench.

    Args:
        policy: whether the policy is enforced; otherwise the router is Zenoh's own.
        settings: changes Zenoh's configuration where no policy is.
    """

    def __init__(self, *, policy: bool, settings: dict[str, Any] | None = None) -> None:
        self.policy = policy
        self._folder = Path(tempfile.mkdtemp(prefix="u"))
        self.endpoint = f"unixsock-stream/{self._folder}/s"
        self.passwords = new_passwords([BENCH_NAME, *ROBOTS])
        self._closing = ExitStack()
        self._settings = settings or {}
        self._reached = threading.Condition()
        self.truths: list[Truth] = []
        self.bench_got: list[tuple[str, bytes]] = []
        self.kept: Any = None
        """What a cheat has declared, which lasts no longer than it is kept."""

    def __enter__(self) -> Self:
        self._closing.callback(shutil.rmtree, self._folder)
        self.router = self._closing.enter_context(zenoh.open(self._router_config()))
        self.world = World(lanes(), seed=0, epoch=EPOCH)
        self.inbox = Inbox(ROBOTS)
        scene = PublicScene(epoch=EPOCH, scene=lanes().scene(with_goals=False))
        self._bus = Bus(self.router, KEYS, scene, ROBOTS, self.inbox)
        self.bench = self.connect(BENCH_NAME)
        self._listener = self.bench.declare_subscriber(KEYS.everything, self._keep)
        self.honest = {robot: HonestRobot(self, robot) for robot in ROBOTS}
        run = Run(self.world, LockStep(PATIENCE_S), self.inbox, self._bus, structlog.get_logger())
        run.wait_for_robots(PATIENCE_S)
        self._runs = threading.Thread(target=run.drive)
        self._runs.start()
        self.passes(2)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        for robot in self.honest.values():
            robot.leave()
        self._closing.close()

    def end(self) -> None:
        """End the run with a verdict."""
        self.inbox.interrupt()
        self._runs.join()
        self.inbox.close()

    def _router_config(self) -> zenoh.Config:
        if not self.policy:
            config = dict(open_settings(self.endpoint).config)
            return zenoh.Config.from_json5(json.dumps(merged(config, self._settings)))
        users = self._folder / "users"
        write_users(users, self.passwords)
        access = Access(listen=self.endpoint, users=users)
        return access.session(KEYS, ROBOTS, structlog.get_logger()).to_zenoh()

    def connect(
        self, name: str | None, password: str | None = None, settings: dict[str, Any] | None = None
    ) -> zenoh.Session:
        """A session of somebody, closed with the stage; an open router asks for no name.

        Raises:
            zenoh.ZError: it is not let in.
        """
        login = None if name is None or not self.policy else Login(name, password or self.passwords[name])
        config = dict(client_session(self.endpoint, login, patience_s=1.5).config)
        config = merged(config, settings or {})
        return self._closing.enter_context(zenoh.open(zenoh.Config.from_json5(json.dumps(config))))

    def _keep(self, sample: zenoh.Sample) -> None:
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        self.bench_got.append((key, payload))
        if key == KEYS.truth and MARK not in payload:
            with self._reached:
                self.truths.append(decode(Truth, payload))
                self._reached.notify_all()

    def passes(self, steps: int) -> None:
        """Wait until the run has gone so many steps further: what was said before has long been handled."""
        with self._reached:
            until = (self.truths[-1].step if self.truths else 0) + steps
            reached = self._reached.wait_for(
                lambda: bool(self.truths) and self.truths[-1].step >= until, PATIENCE_S
            )
        assert reached, "the run stands still"

    def was_undisturbed(self, but_refused: frozenset[str] = frozenset()) -> None:
        """Check that every robot got its own poses only, was obeyed at every step, and drove as commanded.

        Args:
            but_refused: robots of which more may have been said, and refused.
        """
        self.end()
        last = self.world.truth()
        core = World(lanes(), seed=0, epoch=EPOCH)
        while core.step < last.step:
            core.advance({robot: honest(robot, core.step) for robot in ROBOTS})
        assert core.truth().robots == last.robots
        assert all(robot.deadline_misses == 0 for robot in last.robots.values())
        assert self.truths[-1].refused.keys() <= but_refused
        for robot, one in self.honest.items():
            assert {key for key, _ in one.got} == {KEYS.pose(robot)}
            steps = [decode(Observation, payload).step for _, payload in one.got]
            assert steps == list(range(len(steps)))
            assert len(steps) >= last.step


def merged(config: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A configuration with changes at any depth."""
    deep = {
        name: merged(config.get(name, {}), change) if isinstance(change, dict) else change
        for name, change in changes.items()
    }
    return {**config, **deep}


Cheat = Callable[[Stage, Evidence], None]


def secret() -> bytes:
    """Something that nobody else says."""
    return MARK + secrets.token_bytes(4)
