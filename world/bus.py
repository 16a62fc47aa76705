"""The world's side of the bus: its session, what it declares there and what it publishes."""

import threading
from collections.abc import Mapping
from functools import partial

import zenoh

from chassis.refusal import ExitStatus, Refusal
from protocol.codec import encode
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import Observation, PublicScene, Truth
from protocol.session import LATEST_WINS, NEVER_DROP, SessionSettings, reason_of
from world.inbox import Inbox

FAREWELL_S = 10.0
"""How long a reader of the truth may take to see the verdict and leave; seconds, on a very busy machine."""


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
        """Return when nobody reads truths any more: closing the session would cut off a reader that lags.

        Args:
            timeout_s: after which readers that stay are left alone.
        """
        unread = threading.Event()

        def changed(status: zenoh.MatchingStatus) -> None:
            if not status.matching:
                unread.set()

        _listener = self._truth.declare_matching_listener(changed)
        if self._truth.matching_status.matching:  # type: ignore[attr-defined]  # zenoh's stub says bool
            unread.wait(timeout_s)
