"""``python -m fleet.inject.relay``: the link between the world and one robot as a process, with its faults.

Towards the world it is that robot; towards the robot it is the world's router. It takes its settings from the
environment, as a robot does, and from ``UNSPOKEN_LISTEN`` and ``UNSPOKEN_USERS``.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

import zenoh

from chassis.lean import structlog
from chassis.process import end_with_parent, on_wish_to_end
from fleet.inject.link import Link
from fleet.inject.scenario import faults_of_this_process
from protocol.codec import MessageError, decode, encode
from protocol.identity import client_identity
from protocol.keys import Keys
from protocol.messages import Command, Joining, Observation, PublicScene
from protocol.policy import access_control, rights_of
from protocol.session import LATEST_WINS, NEVER_DROP, Opening, client_session, world_session

T = TypeVar("T")
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
        files = (settings.get(f"UNSPOKEN_{name}") for name in ("PASSWORD_FILE", "USERS"))
        password, users = (Path(path) if path else None for path in files)
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

        def later(act: Callable[[T], object]) -> Callable[[T], None]:
            return lambda received: self._due.put(partial(act, received))

        keys, robot = self._keys, self._robot
        with world as self._world, zenoh.open(self._towards_robot.to_zenoh()) as self._to_robot:
            presence = self._to_robot.liveliness()
            _declared = (  # Nothing but the presence of the robot makes the world begin.
                world.declare_subscriber(keys.pose(robot), later(self._show)),
                self._to_robot.declare_queryable(keys.scene_for(robot), later(self._answer)),
                # One for all that the robot says, which keeps its order.
                self._to_robot.declare_subscriber(
                    keys.everything, later(self._hand_on), allowed_origin=zenoh.Locality.REMOTE
                ),
                presence.declare_subscriber(keys.alive(robot), later(self._stand), history=True),
            )
            self._log.info("relaying")
            while (act := self._due.get()) is not None:
                act()

    def _show(self, pose: zenoh.Sample) -> None:
        """Hand on a pose; where the robot cannot answer it, tell the world not to wait."""
        try:
            observation = decode(Observation, pose.payload.to_bytes())
        except MessageError as error:
            self._log.warning("refused an observation", reason=str(error))
            return
        if observation.epoch != self._epoch:
            self._ask_for_scene()
        if observation.epoch != self._epoch:
            return  # of a world that is gone
        delivery, commands = self._link.observed(observation), list(self._link.due(observation.step))
        if not delivery.answerable:
            commands.append(encode(Command.withheld_at(observation.epoch, self._robot, observation.step)))
        for each in delivery.payloads:
            self._to_robot.put(self._keys.pose(self._robot), each, **LATEST_WINS)
        self._say_commands(commands)

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

    def _hand_on(self, said: zenoh.Sample) -> None:
        """Say to the world what the robot says."""
        kind, payload = self._keys.kind_of(str(said.key_expr)), said.payload.to_bytes()
        if kind == "command":
            self._say_commands((payload,) if self._epoch is None else self._link.commanded(payload))
        elif kind == "mind":
            self._world.put(self._keys.mind(self._robot), payload, **NEVER_DROP)

    def _say_commands(self, payloads: Iterable[bytes]) -> None:
        """To the world, as the robot itself would."""
        for payload in payloads:
            self._world.put(self._keys.command(self._robot), payload, **NEVER_DROP)

    def _stand(self, presence: zenoh.Sample) -> None:
        """Be present at the world as long as the robot is present here."""
        if self._token is not None:
            self._token.undeclare()  # type: ignore[no-untyped-call]  # zenoh does not annotate it
            self._token = None
        if presence.kind == zenoh.SampleKind.PUT:
            self._token = self._world.liveliness().declare_token(self._keys.alive(self._robot))


def main() -> None:
    """Relay until SIGTERM."""
    end_with_parent()
    relay = Relay(os.environ)
    on_wish_to_end(relay.stop)
    relay.run()


if __name__ == "__main__":
    main()
