"""``python -m fleet.inject.relay``: the link between the world and one robot as a process, with its faults.

Towards the world it is that robot; towards the robot it is the world's router. It takes its settings from the
environment, as a robot does, and from ``UNSPOKEN_LISTEN`` and ``UNSPOKEN_USERS``.
"""

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import structlog
import zenoh

from chassis.process import end_with_parent, on_wish_to_end
from fleet.inject.link import Link
from fleet.inject.told import faults_told
from protocol.codec import MessageError, decode, encode
from protocol.identity import Identity, client_identity
from protocol.keys import Keys
from protocol.messages import Command, Joining, Observation, PublicScene
from protocol.policy import access_control, rights_of
from protocol.session import (
    LATEST_WINS,
    NEVER_DROP,
    SessionSettings,
    client_session,
    open_in_background,
    world_session,
)

SCENE_TIMEOUT_S = 1.0
"""For the world's answer; without one the robot is not answered, and asks again."""


@dataclass(frozen=True)
class RelayOptions:
    """What a relay is told at its start."""

    robot: str
    run: str
    connect: str
    identity: Identity
    listen: str
    users: Path | None

    def towards_world(self) -> SessionSettings:
        """The session of the robot that it stands for."""
        return client_session(self.connect, self.identity)

    def towards_robot(self) -> SessionSettings:
        """A router that lets the robot do what the world's would."""
        access = None
        if self.users is not None:
            access = access_control(rights_of(Keys(self.run), [self.robot]), "usernames")
        return world_session(self.listen, access, self.users)


class _Pose(NamedTuple):
    payload: bytes


class _Said(NamedTuple):
    """By the robot."""

    kind: str
    payload: bytes


class _Presence(NamedTuple):
    """Of the robot."""

    here: bool


_Event = _Pose | _Said | _Presence | zenoh.Query | zenoh.Session | zenoh.ZError | None
"""What callbacks leave; None stands for the end."""


class Relay:
    """Hands on whatever the world and a robot say, as the link between them lets it.

    The link is a new one in every epoch of the world. Robot and world may come and go.

    Args:
        options: what it is told.
    """

    def __init__(self, options: RelayOptions) -> None:
        self._options = options
        self._keys = Keys(options.run)
        self._log = structlog.get_logger("relay").bind(robot=options.robot)
        self._events: SimpleQueue[_Event] = SimpleQueue()
        self._question = encode(Joining())
        self._scene_payload = b""
        self._epoch: int | None = None
        self._token: zenoh.LivelinessToken | None = None

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from any thread."""
        self._events.put(None)

    def run(self) -> None:
        """Wait for a world, then relay until stopped.

        Raises:
            zenoh.ZError: Zenoh cannot use an endpoint.
        """
        open_in_background(self._options.towards_world(), self._events.put)
        opened = self._events.get()
        if isinstance(opened, zenoh.ZError):
            raise opened
        if not isinstance(opened, zenoh.Session):
            return
        with opened as self._world, zenoh.open(self._options.towards_robot().to_zenoh()) as self._to_robot:
            _declared = self._declare()
            self._log.info("relaying", listen=self._options.listen)
            while (event := self._events.get()) is not None:
                self._take(event)

    def _declare(self) -> tuple[object, ...]:
        """Callbacks only store. Nothing but the presence of the robot makes the world begin."""
        keys, robot, put = self._keys, self._options.robot, self._events.put

        def store_said(sample: zenoh.Sample) -> None:
            put(_Said(keys.kind_of(str(sample.key_expr)), sample.payload.to_bytes()))

        def store_presence(sample: zenoh.Sample) -> None:
            put(_Presence(sample.kind == zenoh.SampleKind.PUT))

        return (
            self._world.declare_subscriber(
                keys.pose(robot), lambda sample: put(_Pose(sample.payload.to_bytes()))
            ),
            self._to_robot.declare_queryable(keys.scene_for(robot), put),
            # One for all that the robot says, which keeps its order.
            self._to_robot.declare_subscriber(
                keys.everything, store_said, allowed_origin=zenoh.Locality.REMOTE
            ),
            self._to_robot.liveliness().declare_subscriber(keys.alive(robot), store_presence, history=True),
        )

    def _take(self, event: _Event) -> None:
        match event:
            case _Pose(payload):
                self._show(payload)
            case _Said("command", payload):
                for each in self._link.commanded(payload) if self._epoch is not None else (payload,):
                    self._say(self._keys.command(self._options.robot), each)
            case _Said("mind", payload):
                self._say(self._keys.mind(self._options.robot), payload)
            case _Presence(here):
                self._stand(here)
            case zenoh.Query():
                self._answer(event)

    def _show(self, payload: bytes) -> None:
        """Hand on a pose; where the robot cannot answer it, tell the world not to wait."""
        try:
            observation = decode(Observation, payload)
        except MessageError as error:
            self._log.warning("refused an observation", reason=str(error))
            return
        if observation.epoch != self._epoch:
            self._ask_for_scene()
        if observation.epoch != self._epoch:
            return  # of a world that is gone
        robot, step = self._options.robot, observation.step
        for late in self._link.due(step):
            self._say(self._keys.command(robot), late)
        delivery = self._link.observed(observation)
        for each in delivery.payloads:
            self._to_robot.put(
                self._keys.pose(robot),
                each,
                **LATEST_WINS,
            )
        if not delivery.answerable:
            nothing = Command.withheld_at(observation.epoch, robot, step)
            self._say(self._keys.command(robot), encode(nothing))

    def _answer(self, query: zenoh.Query) -> None:
        """Tell the robot the scene of the present world, if there is one."""
        with query:
            self._question = query.payload.to_bytes() if query.payload else b""
            if self._ask_for_scene():
                query.reply(self._keys.scene_for(self._options.robot), self._scene_payload)

    def _ask_for_scene(self) -> bool:
        """As the robot has asked."""
        key = self._keys.scene_for(self._options.robot)
        for reply in self._world.get(key, payload=self._question, timeout=SCENE_TIMEOUT_S):
            if reply.ok is not None:
                self._scene_payload = reply.ok.payload.to_bytes()
                self._begin(decode(PublicScene, self._scene_payload))
                return True
        return False

    def _begin(self, public: PublicScene) -> None:
        if public.epoch != self._epoch:
            self._epoch = public.epoch
            self._link = Link(faults_told(public.scene), self._options.robot, public.scene)
            self._log.info("a link for this epoch", epoch=public.epoch)

    def _stand(self, here: bool) -> None:
        """Be present at the world as long as the robot is present here."""
        if self._token is not None:
            self._token.undeclare()  # type: ignore[no-untyped-call]  # zenoh does not annotate it
            self._token = None
        if here:
            self._token = self._world.liveliness().declare_token(self._keys.alive(self._options.robot))

    def _say(self, key: str, payload: bytes) -> None:
        """As the robot itself would."""
        self._world.put(key, payload, **NEVER_DROP)


def main() -> None:
    """Relay until SIGTERM."""
    end_with_parent()
    told = os.environ
    robot, connect = told["UNSPOKEN_ROBOT"], told["UNSPOKEN_CONNECT"]
    password_file, users = _path("UNSPOKEN_PASSWORD_FILE"), _path("UNSPOKEN_USERS")
    identity = client_identity(robot, connect, password_file, None, datetime.now(UTC))
    relay = Relay(
        RelayOptions(robot, told["UNSPOKEN_RUN"], connect, identity, told["UNSPOKEN_LISTEN"], users)
    )
    on_wish_to_end(relay.stop)
    relay.run()


def _path(name: str) -> Path | None:
    return Path(os.environ[name]) if name in os.environ else None


if __name__ == "__main__":
    main()
