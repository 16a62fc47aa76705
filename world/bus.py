"""The world's side of the bus: what it declares on its session, publishes there, and what has arrived."""

import threading
from collections.abc import Iterable, Mapping
from functools import partial
from typing import NamedTuple

import zenoh

from chassis.refusal import ExitStatus, Refusal
from protocol.codec import encode
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import Observation, PublicScene, Truth
from protocol.session import LATEST_WINS, NEVER_DROP, SessionSettings, reason_of

FAREWELL_S = 10.0
"""How long a reader of the truth may take to see the verdict and leave; seconds, on a very busy machine."""
COMMANDS_A_STEP = 16
"""How many a robot may give; one is wanted. Whoever says more waits for the next step, at its own expense."""


class Arrivals(NamedTuple):
    """What has come since the last time."""

    commands: tuple[tuple[str, bytes], ...]
    """Payloads as received with the robot of the key, for each robot oldest first."""
    present: frozenset[str]
    """Whose liveliness token is there now, robots outside the scenario included."""
    gone: frozenset[str]
    """Whose token has gone since the last time, even if it is back."""
    exhausted: frozenset[str]
    """Who has given all the commands that it may give at this step."""
    questions: tuple[tuple[str, bytes], ...]
    """By robot, with what it said last when it asked for the scene."""
    interrupted: bool
    """Whether the run was asked to end; stays true."""


class Inbox:
    """Stores and wakes, and does nothing else, since a failing callback stalls a whole session.

    A robot that has given ``COMMANDS_A_STEP`` is not listened to until the next step: its callback waits,
    then its connection, then the robot. So no command is lost uncounted, a flood costs bounded memory and
    time, and only the flooding robot waits.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        self._changed = threading.Condition()
        self._news = False
        self._commands: list[tuple[str, bytes]] = []
        self._given = dict.fromkeys(robots, 0)
        self._present: set[str] = set()
        self._gone: set[str] = set()
        self._questions: dict[str, bytes] = {}
        self._interrupted = False
        self._closed = False

    def store_command(self, robot: str, payload: bytes) -> None:
        """A payload came on the command key of one of the robots; waits while it has given too many."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._given[robot] < COMMANDS_A_STEP)
            if not self._closed:
                self._given[robot] += 1
                self._commands.append((robot, payload))
                self._wake()

    def store_presence(self, robot: str, *, present: bool) -> None:
        """A robot's liveliness token appeared or went."""
        with self._changed:
            if present:
                self._present.add(robot)
            else:
                self._present.discard(robot)
                self._gone.add(robot)
            self._wake()

    def store_question(self, robot: str, payload: bytes) -> None:
        """One of the robots has asked for the scene."""
        with self._changed:
            self._questions[robot] = payload
            self._wake()

    def interrupt(self) -> None:
        """The run is to end."""
        with self._changed:
            self._interrupted = True
            self._wake()

    def begin_step(self) -> None:
        """Listen to every robot again."""
        with self._changed:
            self._given = dict.fromkeys(self._given, 0)
            self._changed.notify_all()

    def close(self) -> None:
        """No more commands are wanted; whoever waits to give one is released."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def take(self, timeout_s: float) -> Arrivals:
        """Wait for news and take them.

        Args:
            timeout_s: after which empty hands are returned; 0 or less does not wait. An interrupted inbox
                never waits.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._interrupted, timeout=max(timeout_s, 0.0))
            arrivals = Arrivals(
                tuple(self._commands),
                frozenset(self._present),
                frozenset(self._gone),
                frozenset(robot for robot, given in self._given.items() if given >= COMMANDS_A_STEP),
                tuple(self._questions.items()),
                self._interrupted,
            )
            self._commands.clear()
            self._questions.clear()
            self._gone.clear()
            self._news = False
        return arrivals

    def _wake(self) -> None:
        self._news = True
        self._changed.notify_all()


def open_session(listen: str, settings: SessionSettings) -> zenoh.Session:
    """The session at which robots connect.

    Raises:
        Refusal: it cannot be opened.
    """
    try:
        return zenoh.open(settings.to_zenoh())
    except zenoh.ZError as error:
        raise Refusal(
            f"the endpoint {listen} cannot be opened: {reason_of(error)}. If another world listens there, "
            "end it or choose another endpoint with --listen, such as tcp/127.0.0.1:7448.",
            ExitStatus.FAILED,
        ) from error


class Bus:
    """Everything the world declares on its session, and what it publishes there.

    Poses are dropped rather than awaited when a robot does not take them, since one stopped robot would
    otherwise hold up the whole world. Truths are never dropped: the bench records every one.

    Args:
        session: open for as long as the bus is used.
        keys: of this run.
        scene: the answer to queries of the scene.
        robots: ids of the robots that get observations and give commands.
        inbox: where commands and liveliness go.
    """

    def __init__(
        self, session: zenoh.Session, keys: Keys, scene: PublicScene, robots: tuple[str, ...], inbox: Inbox
    ) -> None:
        payload = encode(scene)

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(keys.scene, payload)

        def answer_robot(robot: str, query: zenoh.Query) -> None:
            with query:
                inbox.store_question(robot, query.payload.to_bytes() if query.payload else b"")
                query.reply(keys.scene_for(robot), payload)

        def answer_stranger(query: zenoh.Query) -> None:
            with query:
                asked = str(query.key_expr)
                if keys.robot_of(asked) not in robots:
                    query.reply(asked, payload)

        def store_command(robot: str, sample: zenoh.Sample) -> None:
            inbox.store_command(robot, sample.payload.to_bytes())

        def store_presence(sample: zenoh.Sample) -> None:
            present = sample.kind == zenoh.SampleKind.PUT
            inbox.store_presence(keys.robot_of(str(sample.key_expr)), present=present)

        def store_reader(status: zenoh.MatchingStatus) -> None:
            inbox.store_presence(BENCH_NAME, present=status.matching)

        self._poses = {robot: session.declare_publisher(keys.pose(robot), **LATEST_WINS) for robot in robots}
        self._truth = session.declare_publisher(keys.truth, **NEVER_DROP)
        self._reading = self._truth.declare_matching_listener(store_reader)
        if self._truth.matching_status.matching:  # type: ignore[attr-defined]  # zenoh's stub says bool
            inbox.store_presence(BENCH_NAME, present=True)
        # Presence comes last: a robot that is seen as present can be sure that all else is there.
        self._declared = (
            session.declare_queryable(keys.scene, answer),
            *(
                session.declare_queryable(keys.scene_for(robot), partial(answer_robot, robot))
                for robot in robots
            ),
            session.declare_queryable(keys.everyones_scene, answer_stranger),
            # One for each robot, so that each waits for itself when it has said too much.
            *(
                session.declare_subscriber(keys.command(robot), partial(store_command, robot))
                for robot in robots
            ),
            session.liveliness().declare_subscriber(keys.everyone_alive, store_presence, history=True),
        )

    def publish_observations(self, observations: Mapping[str, Observation]) -> None:
        """Give each robot its own observation."""
        for robot, observation in observations.items():
            self._poses[robot].put(encode(observation))

    def publish_truth(self, truth: Truth) -> None:
        """Give the bench the truth."""
        self._truth.put(encode(truth))

    def wait_for_readers(self, timeout_s: float = FAREWELL_S) -> None:
        """Return when nobody reads truths any more: closing the session would cut off a reader that lags."""
        unread = threading.Event()

        def changed(status: zenoh.MatchingStatus) -> None:
            if not status.matching:
                unread.set()

        _listener = self._truth.declare_matching_listener(changed)
        if self._truth.matching_status.matching:  # type: ignore[attr-defined]  # zenoh's stub says bool
            unread.wait(timeout_s)
