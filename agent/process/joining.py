"""How a robot comes to know the scene of the world that it can reach."""

import zenoh

from protocol.codec import OtherVersionError, decode, encode
from protocol.keys import Keys
from protocol.messages import Joining, PublicScene
from protocol.scene import Scene
from protocol.version import PROTOCOL_VERSION, disagreement


class SceneError(Exception):
    """The world's scene does not fit this robot; the text says why and what to do."""


def refuse_strangers(robot: str, scene: Scene) -> None:
    """Go on only if the scene has this robot.

    Raises:
        SceneError: it has not.
    """
    if robot not in scene.robots:
        raise SceneError(
            f"this world has no robot {robot!r}; its robots are {', '.join(scene.robots)}. "
            "Start this robot with one of these ids, or the world with another scenario."
        )


def ask_for_scene(session: zenoh.Session, keys: Keys, robot: str, timeout_s: float) -> PublicScene | None:
    """The scene of the present world; None if none has answered in time.

    The question tells the world which version of the protocol this robot speaks, and nothing else.

    Raises:
        SceneError: the world speaks another version.
        MessageError: the answer is not valid.
    """
    for reply in session.get(keys.scene_for(robot), payload=encode(Joining()), timeout=timeout_s):
        if reply.ok is not None:
            try:
                return decode(PublicScene, reply.ok.payload.to_bytes())
            except OtherVersionError as error:
                raise SceneError(disagreement(robot, PROTOCOL_VERSION, error.version)) from error
    return None
