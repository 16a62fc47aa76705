"""What the check of a device says of credentials and of worlds, over real sessions."""

import socket
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgpack
import pytest
import structlog
import zenoh
from agent_helpers import EPOCH, scene_of
from checking_helpers import device

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
    monkeypatch.setattr(reach, "SESSION_S", 1.0)
    monkeypatch.setattr(reach, "ANSWERS_S", 1.0)
    monkeypatch.setattr(reach, "LISTENS_S", 1.0)


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


def test_nobody_listens(port, tmp_path):
    assert "nobody listens there; start the world" in refused(device(f"tcp/127.0.0.1:{port}"))
    assert "nobody listens there" in refused(device(f"unixsock-stream/{tmp_path}/none"))


def test_a_host_of_no_such_name():
    assert "knows no host of that name" in refused(device("tcp/no-such-world.invalid:7447"))


def test_an_endpoint_that_is_none():
    assert "the endpoint the hall cannot be used" in refused(device("the hall"))


def test_whoever_listens_may_be_no_world():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        told = refused(device(f"tcp/127.0.0.1:{silent.getsockname()[1]}"))
    assert "somebody listens" in told
    assert "refused, or that is no world" in told


@pytest.fixture
def with_passwords(tmp_path, port):
    users = {"1": "right", "2": "other", "9": "stranger", "@bench": "bench"}
    write_users(tmp_path / "users", users)
    for name, password in {**users, "wrong": "wrong"}.items():
        write_password(tmp_path / name, password)
    receive_on_threads(8)
    with world(f"tcp/127.0.0.1:{port}", users=tmp_path / "users"):
        yield lambda password, **changes: device(
            f"tcp/127.0.0.1:{port}", password_file=tmp_path / password, **changes
        )


def test_a_password_opens_the_world_or_does_not(with_passwords):
    assert checked(with_passwords("1"))[0].state == "ok"
    assert "does not let robot 1 in with the password" in refused(with_passwords("wrong"))


def test_under_a_policy_a_robot_or_run_that_it_does_not_name_is_told_nothing(with_passwords):
    assert "its run is not 'hall'" in refused(with_passwords("1", run="hall"))
    assert "grants nothing to a robot '9'" in refused(with_passwords("9", robot="9"))


def test_a_password_that_cannot_be_read_leaves_the_world_unasked(with_passwords):
    finding, _ = checked(with_passwords("none"))
    assert finding.state == "warning"
    assert "somebody listens" in finding.found


def test_a_robot_or_estimator_that_does_not_fit_the_scene(port):
    endpoint = f"tcp/127.0.0.1:{port}"
    with world(endpoint):
        assert "has no robot '7'; its robots are 1, 2" in refused(device(endpoint, robot="7"))
        assert "goals" in refused(device(endpoint, goals="exchanged"))


def test_a_world_of_another_version(port, monkeypatch):
    endpoint = f"tcp/127.0.0.1:{port}"
    monkeypatch.setattr("world.bus.encode", lambda _: msgpack.packb({"schema_version": 2}))
    with world(endpoint):
        told = refused(device(endpoint))
    assert told == disagreement("1", 1, 2)


def test_keys_open_a_world_of_the_same_authority(port, authority, tmp_path):
    endpoint = f"tls/127.0.0.1:{port}"
    own, foreign = (
        keys_of("1", tmp_path / "own", authority),
        keys_of("1", tmp_path / "other", Authority.new(NOW, 90)),
    )
    with world(endpoint, keys=keys_of(WORLD_NAME, tmp_path, authority)):
        assert checked(device(endpoint, keys=own))[0].state == "ok"
        assert "TLS refused here" in refused(device(endpoint, keys=foreign))


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


def test_a_world_at_a_host_that_its_certificate_does_not_name(port, authority, tmp_path):
    own = keys_of("1", tmp_path, authority)
    with world(f"tls/127.0.0.1:{port}", keys=keys_of(WORLD_NAME, tmp_path, authority, "world.local")):
        told = refused(device(f"tls/127.0.0.1:{port}", keys=own))
    assert "TLS refused here" in told
    assert "--host" in told


def test_a_world_without_tls(port, authority, tmp_path):
    with world(f"tcp/127.0.0.1:{port}"):
        assert "TLS refused there" in refused(
            device(f"tls/127.0.0.1:{port}", keys=keys_of("1", tmp_path, authority))
        )


def credentials(one, now=NOW):
    return check_credentials(one, now)[0]


def test_keys_are_of_this_robot_private_and_last_for_some_time(authority, tmp_path):
    endpoint = "tls/world.local:7447"
    folder = keys_of("1", tmp_path, authority)
    assert credentials(device(endpoint, keys=folder)).state == "ok"
    soon = credentials(device(endpoint, keys=folder), NOW + timedelta(days=20))
    assert (soon.state, "renew them" in soon.remedy) == ("warning", True)
    assert "expired on" in credentials(device(endpoint, keys=folder), NOW + timedelta(days=40)).found
    early = credentials(device(endpoint, keys=folder), NOW - timedelta(days=40))
    assert (early.state, "set the clock" in early.found) == ("failed", True)
    assert "those of robot 2 are expected" in credentials(device(endpoint, keys=folder, robot="2")).found
    (folder / "key.pem").chmod(0o644)
    told = credentials(device(endpoint, keys=folder))
    assert (told.state, "chmod 600" in told.found) == ("failed", True)


def test_a_password_is_private_and_stays_on_this_machine(tmp_path):
    write_password(tmp_path / "one", "right")
    path: Path = tmp_path / "one"
    assert credentials(device("tcp/127.0.0.1:7447", password_file=path)).state == "ok"
    far = credentials(device("tcp/192.0.2.1:7447", password_file=path))
    assert (far.state, "nothing is encrypted" in far.found) == ("warning", True)
    path.chmod(0o644)
    assert "chmod 600" in credentials(device("tcp/127.0.0.1:7447", password_file=path)).found
    assert credentials(device("tcp/127.0.0.1:7447")).found.startswith("none, for a world on this machine")
