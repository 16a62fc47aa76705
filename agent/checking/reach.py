"""Whether the world is there, lets this robot in, and fits it."""

import time
from typing import NamedTuple

import zenoh

from agent.checking.device import Device
from agent.checking.findings import Finding
from agent.checking.listener import UnreachableError, look_at
from agent.joining import SceneError, ask_for_scene, refuse_strangers
from agent.process import make_agent
from protocol.codec import MessageError
from protocol.device_keys import DeviceKeys
from protocol.identity import Identity
from protocol.keys import Keys
from protocol.messages import PublicScene
from protocol.scene import Scene
from protocol.session import brief_session, reason_of
from protocol.version import PROTOCOL_VERSION

ITEM = "world"
SESSION_S = 3.0
"""In this time a session has to come about."""
ANSWERS_S = 3.0
"""In this time the world has to answer."""
PAUSE_S = 0.1
"""Between two questions."""


class Reached(NamedTuple):
    """What has come of it."""

    finding: Finding
    scene: Scene | None = None


def check_world(device: Device, identity: Identity, *, proven: bool) -> Reached:
    """Ask the world for its scene, and nothing else: no presence, no interest, no command.

    Args:
        device: its options.
        identity: that proves who this is.
        proven: whether the credentials can be used; without them only the listener is looked for.
    """
    try:
        look_at(device.connect, identity if isinstance(identity, DeviceKeys) else None)
        if not proven:
            told = f"somebody listens at {device.connect}; not asked, since the credentials have failed"
            return Reached(Finding(ITEM, "warning", told))
        with _session(device, identity) as session:
            return _judged(device, identity, session)
    except (UnreachableError, SceneError) as error:
        return Reached(Finding(ITEM, "failed", str(error)))


def _session(device: Device, identity: Identity) -> zenoh.Session:
    settings = brief_session(device.connect, identity, SESSION_S)
    try:
        config = settings.to_zenoh()
    except zenoh.ZError as error:
        raise UnreachableError(
            f"the endpoint {device.connect} cannot be used: {reason_of(error)}; one such as "
            "tcp/127.0.0.1:7447 is expected in --connect"
        ) from None
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        given = (
            "the password" if device.password_file else "the certificate" if device.keys else "no credentials"
        )
        raise UnreachableError(
            f"somebody listens at {device.connect} and does not let robot {device.robot} in with {given}: "
            "refused, or that is no world; compare them with what the world was given"
        ) from None


def _judged(device: Device, identity: Identity, session: zenoh.Session) -> Reached:
    begin_s = time.perf_counter()
    public = _answer(device, session)
    if public is None:
        told = (
            f"{device.connect} lets this robot in and tells it nothing: its run is not {device.run!r}, or it "
            f"grants nothing to a robot {device.robot!r}; compare --run and --robot with those of the world"
        )
        return Reached(Finding(ITEM, "failed", told))
    took_ms = 1000.0 * (time.perf_counter() - begin_s)
    scene = public.scene
    refuse_strangers(device.robot, scene)
    try:
        make_agent(device.options(identity), scene)
    except ValueError as error:
        raise SceneError(str(error)) from error
    count = len(scene.robots)
    robots = "1 robot" if count == 1 else f"{count} robots"
    told = (
        f"{device.connect} answers in {took_ms:.0f} ms: run {device.run!r} with {robots}, protocol version "
        f"{PROTOCOL_VERSION} like here"
    )
    return Reached(Finding(ITEM, "ok", told), scene)


def _answer(device: Device, session: zenoh.Session) -> PublicScene | None:
    """A world that was started just now answers a moment after it can be reached."""
    until_s = time.monotonic() + ANSWERS_S
    while (remaining_s := until_s - time.monotonic()) > 0.0:
        try:
            public = ask_for_scene(session, Keys(device.run), device.robot, remaining_s)
        except MessageError as error:
            raise SceneError(f"{device.connect} answers what is no scene: {error}") from error
        if public is not None:
            return public
        time.sleep(PAUSE_S)
    return None
