"""What robots may try to reach one another over the network. Each attempt tells whether it got through."""

import errno
import secrets
import socket
import struct
import time
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import ThreadPoolExecutor

from network_namespaces import BROADCAST_ADDRESS, INTERFACE, Place

SILENCE_S = 3.0
"""After which an attempt has failed; what gets through does so in milliseconds."""
SCOUTING = ("224.0.0.224", 7446)
"""Where Zenoh looks for others by multicast."""
ALL_NODES = "ff02::1"
EXPERIMENTAL_ETHER_TYPE = 0x88B5
ICMP_ECHO_REQUEST = struct.pack("!BBHHH", 8, 0, 0, 0, 0)
"""Without a checksum: a listener at a raw socket gets it all the same."""

Attempt = Callable[[Place, Place], bool]


def tcp(source: Place, target: Place) -> bool:
    """Connect to one who listens."""
    with (
        target.socket(socket.AF_INET, socket.SOCK_STREAM) as ear,
        source.socket(socket.AF_INET, socket.SOCK_STREAM) as mouth,
    ):
        ear.bind((target.address, 0))
        ear.listen()
        mouth.settimeout(SILENCE_S)
        try:
            mouth.connect(ear.getsockname())
        except OSError as error:
            # A refusal would have come from the target, so it is none of these.
            if isinstance(error, TimeoutError) or error.errno == errno.EHOSTUNREACH:
                return False
            raise
        return True


def udp(source: Place, target: Place) -> bool:
    """Send a datagram."""
    with _datagrams(target) as ear, _datagrams(source) as mouth:
        ear.bind((target.address, 0))
        return _is_heard(ear, lambda mark: mouth.sendto(mark, ear.getsockname()))


def broadcast(source: Place, target: Place) -> bool:
    """Send a datagram to all on the subnet."""
    with _datagrams(target) as ear, _datagrams(source) as mouth:
        ear.bind(("", 0))
        mouth.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        address = (BROADCAST_ADDRESS, ear.getsockname()[1])
        return _is_heard(ear, lambda mark: mouth.sendto(mark, address))


def multicast(source: Place, target: Place) -> bool:
    """Send a datagram to the group at which Zenoh scouts."""
    with _datagrams(target) as ear, _datagrams(source) as mouth:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        ear.bind(("", SCOUTING[1]))
        group = socket.inet_aton(SCOUTING[0])
        ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + socket.inet_aton(target.address))
        mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(source.address))
        return _is_heard(ear, lambda mark: mouth.sendto(mark, SCOUTING))


def ping(source: Place, target: Place) -> bool:
    """Send an ICMP echo request."""
    with (
        target.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP) as ear,
        source.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP) as mouth,
    ):
        return _is_heard(ear, lambda mark: mouth.sendto(ICMP_ECHO_REQUEST + mark, (target.address, 0)))


def ipv6_link_local(source: Place, target: Place) -> bool:
    """Send a datagram to the address that every IPv6 interface has."""
    return _ipv6(source, target, target.link_local)


def ipv6_all_nodes(source: Place, target: Place) -> bool:
    """Send a datagram to the group of all on the link."""
    return _ipv6(source, target, ALL_NODES)


def frame(source: Place, target: Place) -> bool:
    """Send a bare Ethernet frame to the hardware address, which accomplices know beforehand."""
    with (
        target.socket(socket.AF_PACKET, socket.SOCK_RAW) as ear,
        source.socket(socket.AF_PACKET, socket.SOCK_RAW) as mouth,
    ):
        ear.bind((INTERFACE, EXPERIMENTAL_ETHER_TYPE))
        mouth.bind((INTERFACE, 0))
        receiver, sender = ear.getsockname()[4], mouth.getsockname()[4]
        header = receiver + sender + struct.pack("!H", EXPERIMENTAL_ETHER_TYPE)
        return _is_heard(ear, lambda mark: mouth.send(header + mark))


ATTEMPTS: tuple[Attempt, ...] = (tcp, udp, broadcast, multicast, ping, ipv6_link_local, ipv6_all_nodes, frame)
"""All that need no more than the two on their places."""


def got_through(
    attempts: Collection[Attempt], pairs: Collection[tuple[Place, Place]]
) -> set[tuple[str, str, str]]:
    """Try all at once; attempt, source and target of those that got through."""
    tries = [(attempt, *pair) for attempt in attempts for pair in pairs]
    with ThreadPoolExecutor(len(tries)) as pool:
        reached = pool.map(lambda attempt, *pair: attempt(*pair), *zip(*tries, strict=True))
        return named(each for each, got in zip(tries, reached, strict=True) if got)


def named(tries: Iterable[tuple[Attempt, Place, Place]]) -> set[tuple[str, str, str]]:
    """The same by names, which a failing test can show."""
    return {(attempt.__name__, source.name, target.name) for attempt, source, target in tries}


def _datagrams(place: Place) -> socket.socket:
    return place.socket(socket.AF_INET, socket.SOCK_DGRAM)


def _ipv6(source: Place, target: Place, address: str) -> bool:
    with (
        target.socket(socket.AF_INET6, socket.SOCK_DGRAM) as ear,
        source.socket(socket.AF_INET6, socket.SOCK_DGRAM) as mouth,
    ):
        ear.bind(("::", 0))
        destination = (address, ear.getsockname()[1], 0, source.interface_index())
        return _is_heard(ear, lambda mark: mouth.sendto(mark, destination))


def _is_heard(ear: socket.socket, send: Callable[[bytes], object]) -> bool:
    """Whether what is sent comes, among what may come from others."""
    mark = secrets.token_bytes(16)
    give_up_s = time.monotonic() + SILENCE_S
    send(mark)
    while (rest_s := give_up_s - time.monotonic()) > 0.0:
        ear.settimeout(rest_s)
        try:
            if mark in ear.recv(65535):
                return True
        except TimeoutError:
            break
    return False
