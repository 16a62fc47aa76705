"""``python -m fleet.inject.relay``: the link between the world and one robot as a process, with its faults.

Towards the world it is that robot; towards the robot it is the world's router. It takes its settings from the
environment, as a robot does, and from ``UNSPOKEN_LISTEN`` and ``UNSPOKEN_USERS``.
"""

import os
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import zenoh

from chassis.lean import structlog
from chassis.process import end_with_parent, on_wish_to_end
from fleet.inject.link import Link
from fleet.inject.settings import faults_of_this_process
from protocol.codec import MessageError, decode, encode
from protocol.identity import client_identity
from protocol.keys import Keys
from protocol.messages import Command, Joining, Observation, PublicScene
from protocol.policy import access_control, rights_of
from protocol.session import LATEST_WINS, NEVER_DROP, Opening, client_session, world_session

SCENE_TIMEOUT_S = 1.0
"""For the world's answer; without one the robot is not answered, and asks again."""


class Relay:
    """Hands on whatever the world and a robot say, as the link between them lets it.

    The link is a new one in every epoch of the world. Robot and world may come and go. Callbacks only leave
    what is to be done; all of it is done on the thread of :meth:`run`.

    Args:
        settings: environment variables: those of the robot, of the place to listen, and of the faults.

    Raises:
        Refusal: the robot's password cannot be read.
    """

    def __init__(self, settings: Mapping[str, str]) -> None:
        self._robot, connect = settings["UNSPOKEN_ROBOT"], settings["UNSPOKEN_CONNECT"]
        self._keys = Keys(settings["UNSPOKEN_RUN"])
        password, users = (
            Path(path) if (path := settings.get(f"UNSPOKEN_{name}")) else None
            for name in ("PASSWORD_FILE", "USERS")
        )
        identity = client_identity(self._robot, connect, password, None, datetime.now(UTC))
        self._towards_world = client_session(connect, identity)
        # A router that lets the robot do what the world's would.
        access = access_control(rights_of(self._keys, [self._robot]), "usernames") if users else None
        self._towards_robot = world_session(settings["UNSPOKEN_LISTEN"], access, users)
        self._log = structlog.get_logger("relay").bind(robot=self._robot)
        self._opening = Opening()
        self._due: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._question = encode(Joining())
        self._scene_payload = b""
        self._epoch: int | None = None
        self._token: zenoh.LivelinessToken | None = None

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from any thread."""
        self._opening.stop()
        self._due.put(None)

    def run(self) -> None:
        """Wait for a world, then relay until stopped.

        Raises:
            zenoh.ZError: Zenoh cannot use an endpoint.
        """
        self._opening.begin(self._towards_world)
        world = self._opening.wait(lambda: None)
        if world is None:
            return
        with world as self._world, zenoh.open(self._towards_robot.to_zenoh()) as self._to_robot:
            _declared = self._declare()
            self._log.info("relaying")
            while (act := self._due.get()) is not None:
                act()

    def _declare(self) -> tuple[object, ...]:
        """Nothing but the presence of the robot makes the world begin."""
        keys, robot, put = self._keys, self._robot, self._due.put

        def hand_on(sample: zenoh.Sample) -> None:
            put(partial(self._hand_on, keys.kind_of(str(sample.key_expr)), sample.payload.to_bytes()))

        return (
            self._world.declare_subscriber(
                keys.pose(robot), lambda sample: put(partial(self._show, sample.payload.to_bytes()))
            ),
            self._to_robot.declare_queryable(
                keys.scene_for(robot), lambda query: put(partial(self._answer, query))
            ),
            # One for all that the robot says, which keeps its order.
            self._to_robot.declare_subscriber(keys.everything, hand_on, allowed_origin=zenoh.Locality.REMOTE),
            self._to_robot.liveliness().declare_subscriber(
                keys.alive(robot),
                lambda sample: put(partial(self._stand, sample.kind == zenoh.SampleKind.PUT)),
                history=True,
            ),
        )

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
        for late in self._link.due(observation.step):
            self._say(self._keys.command(self._robot), late)
        delivery = self._link.observed(observation)
        for each in delivery.payloads:
            self._to_robot.put(self._keys.pose(self._robot), each, **LATEST_WINS)
        if not delivery.answerable:
            nothing = Command.withheld_at(observation.epoch, self._robot, observation.step)
            self._say(self._keys.command(self._robot), encode(nothing))

    def _hand_on(self, kind: str, payload: bytes) -> None:
        """Say to the world what the robot says."""
        if kind == "command":
            for each in self._link.commanded(payload) if self._epoch is not None else (payload,):
                self._say(self._keys.command(self._robot), each)
        elif kind == "mind":
            self._say(self._keys.mind(self._robot), payload)

    def _answer(self, query: zenoh.Query) -> None:
        """Tell the robot the scene of the present world, if there is one."""
        with query:
            self._question = query.payload.to_bytes() if query.payload else b""
            if self._ask_for_scene():
                query.reply(self._keys.scene_for(self._robot), self._scene_payload)

    def _ask_for_scene(self) -> bool:
        """As the robot has asked; a new epoch gets a new link."""
        key = self._keys.scene_for(self._robot)
        for reply in self._world.get(key, payload=self._question, timeout=SCENE_TIMEOUT_S):
            if reply.ok is not None:
                self._scene_payload = reply.ok.payload.to_bytes()
                public = decode(PublicScene, self._scene_payload)
                if public.epoch != self._epoch:
                    self._epoch = public.epoch
                    self._link = Link(faults_of_this_process(public.scene), self._robot, public.scene)
                    self._log.info("a link for this epoch", epoch=public.epoch)
                return True
        return False

    def _stand(self, here: bool) -> None:
        """Be present at the world as long as the robot is present here."""
        if self._token is not None:
            self._token.undeclare()  # type: ignore[no-untyped-call]  # zenoh does not annotate it
            self._token = None
        if here:
            self._token = self._world.liveliness().declare_token(self._keys.alive(self._robot))

    def _say(self, key: str, payload: bytes) -> None:
        """As the robot itself would."""
        self._world.put(key, payload, **NEVER_DROP)


def main() -> None:
    """Relay until SIGTERM."""
    end_with_parent()
    relay = Relay(os.environ)
    on_wish_to_end(relay.stop)
    relay.run()


if __name__ == "__main__":
    main()
