"""How a client of the world proves who it is: by a password on one machine, by keys across machines."""

from datetime import datetime
from pathlib import Path

from protocol.device_keys import DeviceKeys, KeysError, check_name, load_device_keys
from protocol.endpoint import UnfitEndpointError, check_keys_fit
from protocol.passwords import Login, PasswordError, read_password

Identity = Login | DeviceKeys | None
"""None: a world that asks for nothing."""


class IdentityError(Exception):
    """What was given cannot prove who this is; the text says why and what to do."""


def client_identity(
    name: str, endpoint: str, password_file: Path | None, keys: Path | None, now: datetime
) -> Identity:
    """What a client proves its name with.

    Args:
        name: a robot's id or that of the bench.
        endpoint: of the world.
        password_file: with its password, if it has one.
        keys: folder with its keys, if it has some.
        now: the time, aware of its zone.

    Raises:
        IdentityError: they do not fit the endpoint or this name, cannot be used, or both are given.
    """
    if password_file is not None and keys is not None:
        raise IdentityError("a password and keys are given; one of them is expected")
    try:
        check_keys_fit(endpoint, keys)
        if keys is not None:
            identity = load_device_keys(keys, now)
            check_name(identity, name)
            return identity
        return None if password_file is None else Login(name, read_password(password_file))
    except (UnfitEndpointError, KeysError, PasswordError) as error:
        raise IdentityError(str(error)) from error
