"""Robots in network namespaces of their own, on a bridge with isolated ports: they reach the world only."""

import signal
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import permutations
from pathlib import Path

import network_namespaces
import pytest
import zenoh_peer
from attempts import ATTEMPTS, got_through, named, ping, tcp, udp
from network_namespaces import Network, NetworkError, Place, command, left
from process_helpers import FAR_SIGHTED, UNSPOKEN, lanes, write_scenario

from fleet.keys.authority import Device
from fleet.keys.folders import create
from protocol.keys import WORLD_NAME

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(network_namespaces.why_not()), reason=network_namespaces.why_not()),
]

LENGTH_M = 0.5


@pytest.fixture(scope="module", autouse=True)
def _permitted() -> None:
    """A container may deny its root what it takes."""
    try:
        with Network(isolated=True):
            pass
    except NetworkError as error:
        if "Operation not permitted" in str(error):
            pytest.skip(f"root may not make network namespaces here: {error}")
        raise


@pytest.fixture
def network(request) -> Iterator[Network]:
    """With isolated ports, if the test does not say otherwise; nothing of it is left."""
    with Network(isolated=getattr(request, "param", True)) as network:
        yield network
    assert left() == []


def keys_for(network: Network, directory: Path) -> Path:
    """As ``unspoken keys create`` makes them."""
    world = Device(WORLD_NAME, (network.world.address,))
    robots = [Device(robot.name) for robot in network.robots]
    create(directory, [world, *robots], datetime.now(UTC), days=30, authority_days=300)
    return directory


def test_a_run_with_keys_arrives_across_namespaces(network, process, tmp_path):
    keys, endpoint = keys_for(network, tmp_path / "keys"), f"tls/{network.world.address}:7447"
    robots = lanes(len(network.robots), LENGTH_M)
    scenario = write_scenario(tmp_path / "lanes.yaml", robots, horizons=FAR_SIGHTED)

    def start(place: Place, module: str, **options: object):
        env = {f"UNSPOKEN_{name.upper()}": value for name, value in options.items()}
        return process(place.name, module, env=env, program=(*place.prefix(), UNSPOKEN))

    robots = [
        start(
            place,
            "agent",
            robot=place.name,
            goal=f"{LENGTH_M},{2.0 * y},0",
            connect=endpoint,
            keys=keys / f"robot-{place.name}",
        )
        for y, place in enumerate(network.robots)
    ]
    world = start(network.world, "world", scenario=scenario, listen=endpoint, keys=keys / "world")
    assert world.end() == 0, world.told + world.complained
    assert "verdict=arrived" in world.told
    for robot in robots:
        assert "joined" in robot.told
        robot.signal(signal.SIGTERM)
        assert robot.end() == 0
        assert robot.complained == ""


@pytest.mark.parametrize("network", [True, False], ids=["isolated", "not isolated"], indirect=True)
def test_robots_reach_the_world_and_one_another_only_if_their_ports_are_not_isolated(network):
    everybody = set(permutations(network.places, 2))
    among_robots = set(permutations(network.robots, 2))
    open_to_each_other = everybody - among_robots if network.isolated else everybody
    expected = ((attempt, *pair) for attempt in ATTEMPTS for pair in open_to_each_other)
    assert got_through(ATTEMPTS, everybody) == named(expected)
    # All have asked for all others' hardware addresses by now.
    assert {(one, other) for one, other in everybody if one.knows(other)} == open_to_each_other


@pytest.mark.parametrize("network", [True, False], ids=["isolated", "not isolated"], indirect=True)
def test_zenoh_peers_of_two_robots_find_each_other_only_if_ports_are_not_isolated(network, process):
    one, two, _ = network.robots
    endpoint = f"tcp/{one.address}:7448"

    def peer(name: str, place: Place, what: str):
        program = (*place.prefix(), sys.executable, "-P", zenoh_peer.__file__)
        return process(name, what, endpoint, program=program)

    listener = peer("listener", one, "listen")
    listener.tells("ready")
    from_robot = peer("from-robot", two, "connect")
    if network.isolated:
        assert from_robot.end() == 1, from_robot.complained
        assert "Unable to connect" in from_robot.complained
        # It does listen: the world's greeting comes, and before it none of the robot's.
        assert peer("from-world", network.world, "connect").end() == 0
        listener.tells(zenoh_peer.GREETING)
        assert listener.told.count(zenoh_peer.GREETING) == 1
    else:
        assert from_robot.end() == 0, from_robot.complained
        listener.tells(zenoh_peer.GREETING)


@pytest.mark.parametrize("forwarding", [False, True], ids=["world forwards nothing", "world forwards"])
def test_robots_that_use_the_world_as_a_gateway_reach_one_another_only_if_it_forwards(network, forwarding):
    ways = list(permutations(network.robots[:2]))
    network.world.set("ipv4/ip_forward", int(forwarding))
    for robot, other in ways:
        # They do not let the world tell them of a shorter way, which is none.
        for interface in ("all", network_namespaces.INTERFACE):
            robot.set(f"ipv4/conf/{interface}/accept_redirects", 0)
        route = (other.address, "via", network.world.address)
        command("ip", "-n", robot.namespace, "route", "add", *route)
    attempts = (tcp, udp, ping)
    expected = ((attempt, *way) for attempt in attempts for way in ways if forwarding)
    assert got_through(attempts, ways) == named(expected)


def test_a_set_up_that_fails_half_way_leaves_nothing(monkeypatch):
    monkeypatch.setitem(network_namespaces.HOSTS, "2", 999)
    with pytest.raises(NetworkError, match=r"10\.77\.0\.999"), Network(isolated=True):
        pass
    assert left() == []
