"""Keys as ``unspoken keys`` makes them, in real sessions: who is let in and who is not.

Zenoh tells neither side of a refusal: a robot that is refused tries again, so here it is given a time to end.
Each refusal is tried beside a robot with good keys, which the same world lets in.
"""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from queue import Queue

import pytest
import zenoh
from certificate_helpers import DAYS, keys_of, new_authority

from fleet.keys.authority import Authority
from protocol.identity import DeviceKeys
from protocol.keys import BENCH_NAME, WORLD_NAME, Keys
from protocol.policy import AccessControl, access_control, rights_of
from protocol.session import NEVER_DROP, SessionSettings, client_session, world_session

NOW = datetime.now(UTC).replace(microsecond=0)
LONG_AGO = NOW - timedelta(days=DAYS + 1)
PATIENCE_S = 60
"""Ends a test that would otherwise wait for ever; nothing is asserted about times."""
REFUSED_S = 1.5
"""After which a robot gives up: in the time of dozens of good connections."""
KEYS = Keys("test")


@pytest.fixture(scope="module")
def authority() -> Authority:
    return new_authority(NOW)


@pytest.fixture
def good(tmp_path: Path, authority: Authority) -> Path:
    return keys_of("7", tmp_path, authority, NOW)


@pytest.fixture
def world_keys(tmp_path: Path, authority: Authority) -> Path:
    return keys_of(WORLD_NAME, tmp_path, authority, NOW)


def taken_as_they_are(folder: Path) -> DeviceKeys:
    """Keys that nobody has checked, so that Zenoh has to."""
    return DeviceKeys(folder, "whoever", NOW)


def opened(settings: SessionSettings, **changed: object) -> zenoh.Session:
    """A session with some of its TLS settings changed; None takes one away."""
    config = json.loads(json.dumps(settings.config))
    tls = config["transport"]["link"]["tls"] | changed
    config["transport"]["link"]["tls"] = {name: value for name, value in tls.items() if value is not None}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


@contextmanager
def world_with(
    folder: Path, *, mtls: bool = True, access: AccessControl | None = None
) -> Iterator[tuple[zenoh.Session, str]]:
    """A world that listens with these keys, and its endpoint; another process may take a free port before."""
    for _ in range(10):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            endpoint = f"tls/127.0.0.1:{free.getsockname()[1]}"
        try:
            session = opened(world_session(endpoint, access, taken_as_they_are(folder)), enable_mtls=mtls)
        except zenoh.ZError as error:
            if "in use" not in str(error):
                raise
        else:
            with session:
                yield session, endpoint
            return
    raise AssertionError("no free port in ten attempts")


def robot_with(endpoint: str, folder: Path, **changed: object) -> zenoh.Session:
    return opened(client_session(endpoint, taken_as_they_are(folder), REFUSED_S), **changed)


def is_let_in(endpoint: str, folder: Path, **changed: object) -> bool:
    try:
        robot = robot_with(endpoint, folder, **changed)
    except zenoh.ZError as error:
        if "Unable to connect" not in str(error):
            raise
        return False
    with robot:
        return bool(robot.info.routers_zid())


def test_clients_with_keys_of_the_worlds_authority_are_let_in_and_others_are_refused(
    world_keys: Path, good: Path, tmp_path: Path, authority: Authority
) -> None:
    """The stranger trusts the world's authority, so that the refusal is the world's."""
    stranger = keys_of("8", tmp_path, new_authority(NOW), NOW)
    (stranger / "authority.pem").write_bytes((good / "authority.pem").read_bytes())
    bench = keys_of(BENCH_NAME, tmp_path, authority, NOW)
    none = {"connect_certificate": None, "connect_private_key": None, "enable_mtls": None}
    with world_with(world_keys) as (_, endpoint):
        assert is_let_in(endpoint, good)
        assert is_let_in(endpoint.replace("127.0.0.1", "localhost"), bench)
        assert not is_let_in(endpoint, stranger)
        assert not is_let_in(endpoint, good, **none)
    with world_with(world_keys, mtls=False) as (_, endpoint):  # it is the mutual TLS that refuses them
        assert is_let_in(endpoint, stranger)
        assert is_let_in(endpoint, good, **none)


def test_who_has_expired_is_refused(tmp_path: Path) -> None:
    authority = new_authority(LONG_AGO)
    expired, good = (keys_of(name, tmp_path, authority, at) for name, at in (("8", LONG_AGO), ("9", NOW)))
    with world_with(keys_of(WORLD_NAME, tmp_path, authority, NOW)) as (_, endpoint):
        assert not is_let_in(endpoint, expired)
        assert is_let_in(endpoint, good)
    (late := tmp_path / "late").mkdir()
    with world_with(keys_of(WORLD_NAME, late, authority, LONG_AGO)) as (_, endpoint):
        assert not is_let_in(endpoint, good)


def test_a_robot_refuses_whoever_is_not_its_world(good: Path, tmp_path: Path, authority: Authority) -> None:
    """Of another authority, which trusts the robot's; for a client; or at a host that it does not name."""
    (elsewhere := tmp_path / "elsewhere").mkdir()
    imposter = keys_of(WORLD_NAME, elsewhere, new_authority(NOW), NOW)
    (imposter / "authority.pem").write_bytes(authority.certificate_pem)
    for folder in (imposter, keys_of("8", tmp_path, authority, NOW, "127.0.0.1")):
        with world_with(folder) as (_, endpoint):
            assert not is_let_in(endpoint, good)
    with world_with(keys_of(WORLD_NAME, tmp_path, authority, NOW, "localhost")) as (_, endpoint):
        assert not is_let_in(endpoint, good)
        assert is_let_in(endpoint.replace("127.0.0.1", "localhost"), good)


def test_zenoh_grants_access_by_the_name_in_the_certificate(
    world_keys: Path, tmp_path: Path, authority: Authority
) -> None:
    """Robot 7 may say what robot 7 wants, robot 8 may not."""
    key = KEYS.command("7")
    heard: Queue[bytes] = Queue()
    access = access_control(rights_of(KEYS, ["7", "8"]), "cert_common_names")
    with world_with(world_keys, access=access) as (world, endpoint):
        world.declare_subscriber(key, lambda sample: heard.put(bytes(sample.payload)))
        for name in ("8", "7"):
            with robot_with(endpoint, keys_of(name, tmp_path, authority, NOW)) as robot:
                robot.put(key, name.encode(), **NEVER_DROP)
        assert heard.get(timeout=PATIENCE_S) == b"7"
        assert heard.empty()
