"""Whether a device can prove that it is this robot."""

from datetime import datetime

from agent.check.findings import Device, Finding
from chassis.refusal import Refusal
from protocol.device_keys import RENEW, DeviceKeys, date_text
from protocol.identity import Identity, client_identity, is_local

ITEM = "credentials"


def check_credentials(device: Device, now: datetime) -> tuple[Finding, Identity]:
    """What it proves its name with, read and looked through; the identity is none where that has failed.

    Args:
        device: its options.
        now: the time, aware of its zone.
    """
    try:
        identity = client_identity(device.robot, device.connect, device.password_file, device.keys, now)
    except Refusal as error:
        return Finding(ITEM, "failed", str(error)), None
    return _finding(device, identity, now), identity


def _finding(device: Device, identity: Identity, now: datetime) -> Finding:
    if isinstance(identity, DeviceKeys):
        text = (
            f"keys of robot {identity.name} in {identity.folder}, valid until {date_text(identity.expires)}"
        )
        if identity.expire_soon(now):
            return Finding(ITEM, "warning", text, RENEW)
        return Finding(ITEM, "ok", text)
    if not is_local(device.connect):
        return Finding(
            ITEM,
            "warning",
            f"nothing is encrypted on the way to {device.connect}: who listens can pass for this robot",
            "use keys, as 'unspoken keys create' makes them, and an endpoint tls/…",
        )
    if identity is None:
        return Finding(ITEM, "ok", "none, for a world on this machine that asks for none")
    return Finding(ITEM, "ok", f"password in {device.password_file}")
