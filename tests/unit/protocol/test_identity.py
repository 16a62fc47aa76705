"""With what a client proves who it is, and what is told when that cannot work."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from certificate_helpers import keys_of, new_authority

from chassis.refusal import Refusal
from protocol.device_keys import DeviceKeys
from protocol.identity import Login, client_identity, write_password
from protocol.session import client_session

NOW = datetime.now(UTC).replace(microsecond=0)
TCP, TLS = "tcp/127.0.0.1:7447", "tls/127.0.0.1:7447"


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return keys_of("7", tmp_path, new_authority(NOW), NOW)


@pytest.fixture
def password_file(tmp_path: Path) -> Path:
    path = tmp_path / "password"
    write_password(path, "secret")
    return path


def test_a_password_keys_or_nothing_is_what_a_client_proves_itself_with(
    keys: Path, password_file: Path
) -> None:
    assert client_identity("7", TCP, None, None, NOW) is None
    assert client_identity("7", TCP, password_file, None, NOW) == Login("7", "secret")
    own = client_identity("7", TLS, None, keys, NOW)
    assert isinstance(own, DeviceKeys)
    tls = client_session(TLS, own).config["transport"]["link"]["tls"]
    assert (tls["root_ca_certificate"], tls["connect_private_key"]) == (
        str(keys / "authority.pem"),
        str(keys / "key.pem"),
    )
    assert "listen_private_key" not in tls


def test_what_cannot_prove_it_is_told(keys: Path, password_file: Path) -> None:
    for name, endpoint, password, folder, told in (
        ("7", TLS, password_file, keys, "one of them is expected"),
        ("7", TCP, None, keys, "keys prove nothing there"),
        ("7", TLS, None, None, "expected in --keys"),
        ("8", TLS, None, keys, "the keys of robot 7, those of robot 8 are expected"),
        ("7", TCP, Path("/nowhere/password"), None, "cannot be read"),
    ):
        with pytest.raises(Refusal, match=told):
            client_identity(name, endpoint, password, folder, NOW)


def test_the_settings_of_a_session_do_not_show_the_password() -> None:
    assert "secret" not in repr(client_session(TCP, Login("7", "secret")))
