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
from typing import Any

import pytest
import zenoh
from certificate_helpers import DAYS, keys_of, new_authority

from fleet.keys.authority import Authority
from protocol.keys import BENCH_NAME, WORLD_NAME
from protocol.session import NEVER_DROP, SessionSettings, client_session, world_session

NOW = datetime.now(UTC).replace(microsecond=0)
PATIENCE_S = 60
"""Ends a test that would otherwise wait for ever; nothing is asserted about times."""
REFUSED_S = 1.5
"""After which a robot gives up: in the time of dozens of good connections."""
Tree = dict[str, Any]
KEY = "unspoken/test/command/7"


@pytest.fixture(scope="module")
def authority() -> Authority:
    return new_authority(NOW)


@pytest.fixture
def good(tmp_path: Path, authority: Authority) -> Path:
    return keys_of("7", tmp_path, authority, NOW)


@pytest.fixture
def world_keys(tmp_path: Path, authority: Authority) -> Path:
    return keys_of(WORLD_NAME, tmp_path, authority, NOW)


def config(settings: SessionSettings, tls: Tree, access: Tree | None = None) -> zenoh.Config:
    tree = json.loads(json.dumps(settings.config))
    tree["transport"]["link"] |= {"protocols": ["tls"], "tls": tls}
    return zenoh.Config.from_json5(json.dumps(tree | ({"access_control": access} if access else {})))


@contextmanager
def world_with(
    folder: Path, *, mtls: bool = True, access: Tree | None = None
) -> Iterator[tuple[zenoh.Session, str]]:
    """A world that listens with these keys, and its endpoint."""
    tls: Tree = {
        "root_ca_certificate": str(folder / "authority.pem"),
        "listen_certificate": str(folder / "certificate.pem"),
        "listen_private_key": str(folder / "key.pem"),
        "enable_mtls": mtls,
        "close_link_on_expiration": True,
    }
    session, endpoint = _listening(tls, access)
    with session:
        yield session, endpoint


def _listening(tls: Tree, access: Tree | None) -> tuple[zenoh.Session, str]:
    """At a free port: another process may take it meanwhile, then another one is tried."""
    for _ in range(10):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            endpoint = f"tls/127.0.0.1:{free.getsockname()[1]}"
        try:
            return zenoh.open(config(world_session(endpoint), tls, access)), endpoint
        except zenoh.ZError as error:
            if "in use" not in str(error):
                raise
    raise AssertionError("no free port in ten attempts")


def open_robot(endpoint: str, folder: Path) -> zenoh.Session:
    return zenoh.open(
        config(
            client_session(endpoint, patience_s=REFUSED_S),
            {
                "root_ca_certificate": str(folder / "authority.pem"),
                "connect_certificate": str(folder / "certificate.pem"),
                "connect_private_key": str(folder / "key.pem"),
                "enable_mtls": True,
                "verify_name_on_connect": True,
                "close_link_on_expiration": True,
            },
        )
    )


def is_let_in(endpoint: str, folder: Path) -> bool:
    try:
        robot = open_robot(endpoint, folder)
    except zenoh.ZError as error:
        if "Unable to connect" not in str(error):
            raise
        return False
    with robot:
        return bool(robot.info.routers_zid())


@pytest.mark.parametrize("name", ["7", "Robot_2-b", BENCH_NAME])
def test_world_and_client_speak_with_keys_of_one_authority(
    world_keys: Path, tmp_path: Path, authority: Authority, name: str
) -> None:
    folder = keys_of(name, tmp_path, authority, NOW)
    heard: Queue[bytes] = Queue()
    with world_with(world_keys) as (world, endpoint):
        world.declare_subscriber(KEY, lambda sample: heard.put(bytes(sample.payload)))
        with open_robot(endpoint, folder) as robot:
            robot.put(KEY, b"hello", **NEVER_DROP)
            assert heard.get(timeout=PATIENCE_S) == b"hello"


def test_the_world_is_found_by_its_name_too(world_keys: Path, good: Path) -> None:
    with world_with(world_keys) as (_, endpoint):
        assert is_let_in(endpoint.replace("127.0.0.1", "localhost"), good)


def test_a_robot_of_another_authority_is_refused(world_keys: Path, good: Path, tmp_path: Path) -> None:
    """It trusts the world's authority, so that the refusal is the world's."""
    stranger = keys_of("8", tmp_path, new_authority(NOW), NOW)
    (stranger / "authority.pem").write_bytes((good / "authority.pem").read_bytes())
    with world_with(world_keys) as (_, endpoint):
        assert not is_let_in(endpoint, stranger)
        assert is_let_in(endpoint, good)
    with world_with(world_keys, mtls=False) as (_, endpoint):
        assert is_let_in(endpoint, stranger)


def test_a_robot_refuses_the_world_of_another_authority(
    good: Path, tmp_path: Path, authority: Authority
) -> None:
    """The world trusts the robot's authority, so that the refusal is the robot's."""
    imposter = keys_of(WORLD_NAME, tmp_path, new_authority(NOW), NOW)
    (imposter / "authority.pem").write_bytes(authority.certificate_pem)
    with world_with(imposter) as (_, endpoint):
        assert not is_let_in(endpoint, good)


def test_an_expired_robot_is_refused(tmp_path: Path) -> None:
    once = NOW - timedelta(days=DAYS + 1)
    authority = new_authority(once)
    expired = keys_of("8", tmp_path, authority, once)
    with world_with(keys_of(WORLD_NAME, tmp_path, authority, NOW)) as (_, endpoint):
        assert not is_let_in(endpoint, expired)
        assert is_let_in(endpoint, keys_of("9", tmp_path, authority, NOW))


def test_an_expired_world_is_refused(tmp_path: Path) -> None:
    once = NOW - timedelta(days=DAYS + 1)
    authority = new_authority(once)
    with world_with(keys_of(WORLD_NAME, tmp_path, authority, once)) as (_, endpoint):
        assert not is_let_in(endpoint, keys_of("9", tmp_path, authority, NOW))


def test_a_robot_without_keys_is_refused_because_mutual_tls_is_on(world_keys: Path, good: Path) -> None:
    def is_let_in_without_keys(endpoint: str) -> bool:
        tls: Tree = {"root_ca_certificate": str(good / "authority.pem")}
        try:
            robot = zenoh.open(config(client_session(endpoint, patience_s=REFUSED_S), tls))
        except zenoh.ZError:
            return False
        with robot:
            return bool(robot.info.routers_zid())

    with world_with(world_keys) as (_, endpoint):
        assert not is_let_in_without_keys(endpoint)
    with world_with(world_keys, mtls=False) as (_, endpoint):
        assert is_let_in_without_keys(endpoint)


def test_a_world_at_a_host_that_its_certificate_does_not_name_is_refused(
    good: Path, tmp_path: Path, authority: Authority
) -> None:
    with world_with(keys_of(WORLD_NAME, tmp_path, authority, NOW, "localhost")) as (_, endpoint):
        assert not is_let_in(endpoint, good)
        assert is_let_in(endpoint.replace("127.0.0.1", "localhost"), good)


def test_a_robot_cannot_be_taken_for_the_world(good: Path, tmp_path: Path, authority: Authority) -> None:
    """Although it says that it is at the right host: its certificate is for a client."""
    robot_at_the_host = keys_of("8", tmp_path, authority, NOW, "127.0.0.1")
    with world_with(robot_at_the_host) as (_, endpoint):
        assert not is_let_in(endpoint, good)


def test_zenoh_grants_access_by_the_name_in_the_certificate(
    world_keys: Path, tmp_path: Path, authority: Authority
) -> None:
    """Robot 7 may say what robot 7 wants, robot 8 may not."""
    access = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": "commands",
                "permission": "allow",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": [KEY],
            }
        ],
        "subjects": [{"id": "7", "cert_common_names": ["7"]}],
        "policies": [{"rules": ["commands"], "subjects": ["7"]}],
    }
    heard: Queue[bytes] = Queue()
    with world_with(world_keys, access=access) as (world, endpoint):
        world.declare_subscriber(KEY, lambda sample: heard.put(bytes(sample.payload)))
        for name in ("8", "7"):
            with open_robot(endpoint, keys_of(name, tmp_path, authority, NOW)) as robot:
                robot.put(KEY, name.encode(), **NEVER_DROP)
        assert heard.get(timeout=PATIENCE_S) == b"7"
        assert heard.empty()
