"""What the check of a device says of credentials and of worlds, over real sessions."""

import socket
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta

import msgpack
import pytest
import structlog
import zenoh
from agent_helpers import EPOCH, device, scene_of

from agent.check import world as reach
from agent.check.device import check_credentials
from fleet.keys.authority import LOCAL_HOSTS, Authority, Device
from fleet.keys.folders import write_device
from protocol.identity import write_password, write_users
from protocol.keys import WORLD_NAME, Keys
from protocol.messages import PublicScene
from protocol.session import receive_on_threads
from protocol.version import disagreement
from world.access import Access
from world.bus import Bus, Inbox

NOW = datetime.now(UTC).replace(microsecond=0)
KEYS = Keys("run")
ROBOTS = ("1", "2")


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    """Refusals are silence, which is waited for."""
    monkeypatch.setattr(reach, "PATIENCE_S", 1.0)


@pytest.fixture
def port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.fixture(scope="module")
def authority():
    return Authority.new(NOW, 300)


def keys_of(name, folder, authority, *hosts, days=30):
    places = hosts or (LOCAL_HOSTS if name == WORLD_NAME else ())
    holder = Device(name, places)
    folder.mkdir(exist_ok=True)
    write_device(folder, authority, holder, NOW, days)
    return folder / holder.folder


@contextmanager
def world(listen, **proof):
    """A world of robots 1 and 2 that waits for them."""
    inbox = Inbox(ROBOTS)
    scene = PublicScene(epoch=EPOCH, scene=scene_of(ROBOTS))
    settings = Access(listen=listen, **proof).session(KEYS, ROBOTS, structlog.get_logger())
    with zenoh.open(settings.to_zenoh()) as session, closing(inbox):
        _bus = Bus(session, KEYS, scene, ROBOTS, inbox)
        yield inbox


def checked(one):
    """The world as this device finds it."""
    credentials, identity = check_credentials(one, NOW)
    return reach.check_world(one, identity, proven=credentials.state != "failed")


def test_a_world_that_is_there_tells_its_scene_and_is_not_disturbed(port):
    with world(f"tcp/127.0.0.1:{port}") as inbox:
        finding, scene = checked(device(f"tcp/127.0.0.1:{port}"))
        arrived = inbox.take(0.5)
    assert scene == scene_of(ROBOTS)
    assert finding.state == "ok"
    assert "run 'run' with 2 robots, protocol version 1 like here" in finding.found
    assert [robot for robot, _ in arrived.questions] == ["1"]
    assert arrived == ((), frozenset(), frozenset(), frozenset(), arrived.questions, False)


def refused(one):
    finding, scene = checked(one)
    assert (finding.state, scene) == ("failed", None)
    return finding.found


@pytest.mark.parametrize(
    ("connect", "words"),
    [
        ("tcp/127.0.0.1:{port}", "nobody listens there; start the world"),
        ("unixsock-stream/{folder}/none", "nobody listens there; start the world"),
        ("tcp/no-such-world.invalid:7447", "knows no host of that name"),
        ("tcp/127.0.0.1:{silent}", "somebody listens"),
        ("the hall", "the endpoint the hall cannot be used"),
    ],
)
def test_an_endpoint_at_which_there_is_no_world(connect, words, port, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        names = {"port": port, "silent": silent.getsockname()[1], "folder": tmp_path}
        assert words in refused(device(connect.format(**names)))


def test_a_robot_an_estimator_or_tls_that_does_not_fit_the_world(port, authority, tmp_path):
    keys = keys_of("1", tmp_path, authority)
    with world(f"tcp/127.0.0.1:{port}"):
        for one, words in (
            (device(f"tcp/127.0.0.1:{port}", robot="7"), "has no robot '7'; its robots are 1, 2"),
            (device(f"tcp/127.0.0.1:{port}", goals="exchanged"), "goals"),
            (device(f"tls/127.0.0.1:{port}", keys=keys), "TLS refused there"),
        ):
            assert words in refused(one)


def test_a_world_of_another_version(port, monkeypatch):
    endpoint = f"tcp/127.0.0.1:{port}"
    monkeypatch.setattr("world.bus.encode", lambda _: msgpack.packb({"schema_version": 2}))
    with world(endpoint):
        assert refused(device(endpoint)) == disagreement("1", 1, 2)


def test_under_a_policy_passwords_open_the_world_to_the_robots_that_it_names(tmp_path, port):
    users = {"1": "right", "2": "other", "9": "stranger", "@bench": "bench"}
    write_users(tmp_path / "users", users)
    for name, password in {**users, "wrong": "wrong"}.items():
        write_password(tmp_path / name, password)
    receive_on_threads(8)

    def found(password, **changes):
        one = device(f"tcp/127.0.0.1:{port}", password_file=tmp_path / password, **changes)
        finding, _ = checked(one)
        return finding.state, finding.found

    with world(f"tcp/127.0.0.1:{port}", users=tmp_path / "users"):
        for (state, told), expected, words in (
            (found("1"), "ok", "run 'run'"),
            (found("wrong"), "failed", "does not let robot 1 in with the password"),
            (found("1", run="hall"), "failed", "its run is not 'hall'"),
            (found("9", robot="9"), "failed", "grants nothing to a robot '9'"),
            (found("none"), "warning", "somebody listens"),  # a file that cannot be read
        ):
            assert state == expected
            assert words in told


def test_keys_open_a_world_of_the_same_authority_at_a_host_that_it_names(port, authority, tmp_path):
    endpoint, foreign = f"tls/127.0.0.1:{port}", Authority.new(NOW, 90)
    own, other = keys_of("1", tmp_path / "own", authority), keys_of("1", tmp_path / "other", foreign)
    with world(endpoint, keys=keys_of(WORLD_NAME, tmp_path, authority)):
        assert checked(device(endpoint, keys=own))[0].state == "ok"
        assert "TLS refused here" in refused(device(endpoint, keys=other))
    elsewhere = tmp_path / "elsewhere"
    with world(endpoint, keys=keys_of(WORLD_NAME, elsewhere, authority, "world.local")):
        told = refused(device(endpoint, keys=own))
    assert "TLS refused here" in told
    assert "--host" in told


def test_a_world_that_does_not_believe_this_device_is_told_apart(port, authority, tmp_path):
    """It believes another authority only, and shows a certificate that this device believes."""
    endpoint, other = f"tls/127.0.0.1:{port}", Authority.new(NOW, 30)
    folder = keys_of(WORLD_NAME, tmp_path, authority)
    own = keys_of("1", tmp_path / "own", authority)
    other_one = keys_of("2", tmp_path / "other", other)
    settings = Access(listen=endpoint, keys=folder).session(KEYS, ROBOTS, structlog.get_logger())
    (folder / "authority.pem").write_bytes((other_one / "authority.pem").read_bytes())
    with zenoh.open(settings.to_zenoh()):
        assert "TLS refused there" in refused(device(endpoint, keys=own))


@pytest.mark.parametrize(
    ("proof", "host", "days", "state", "words"),
    [
        ("keys", "world.local", 0, "ok", "valid until"),
        ("keys", "world.local", 20, "warning", "renew them"),
        ("keys", "world.local", 40, "failed", "expired on"),
        ("password_file", "127.0.0.1", 0, "ok", "password in"),
        ("password_file", "192.0.2.1", 0, "warning", "nothing is encrypted"),
        (None, "127.0.0.1", 0, "ok", "none, for a world on this machine"),
    ],
)
def test_credentials_prove_the_robot_and_are_not_given_away(
    proof, host, days, state, words, authority, tmp_path
):
    """What makes them invalid is tested with them."""
    write_password(tmp_path / "password", "right")
    proofs = {"keys": keys_of("1", tmp_path, authority), "password_file": tmp_path / "password"}
    scheme = "tls" if proof == "keys" else "tcp"
    one = device(f"{scheme}/{host}:7447", **({proof: proofs[proof]} if proof else {}))
    finding, _ = check_credentials(one, NOW + timedelta(days=days))
    assert finding.state == state
    assert words in finding.found + finding.remedy
