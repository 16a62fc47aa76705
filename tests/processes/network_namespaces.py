"""A world and robots on a network of their own: every one in a network namespace, a bridge between them.

The bridge stands in a namespace too, so that nothing is changed on the network of the machine.
"""

import ctypes
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

PATIENCE_S = 30.0
INTERFACE = "eth0"
BRIDGE = "bridge"
WORLD = "world"
BROADCAST_ADDRESS = "10.77.0.255"
HOSTS = {WORLD: 10, "1": 1, "2": 2, "3": 3}
"""The last part of everybody's address."""
_CLONE_NEWNET = 0x40000000
_PREFIX = f"unspoken-{os.getpid()}-"
_LIBC = ctypes.CDLL(None, use_errno=True)


class NetworkError(Exception):
    """A command that sets up the network has failed; the text says which, and why."""


def why_not() -> str:
    """Why there can be no namespaces here; empty if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    missing = [name for name in ("ip", "bridge") if shutil.which(name) is None]
    return f"there is no command {' and no '.join(missing)}; the package iproute2 has them" if missing else ""


def command(*arguments: object) -> str:
    """Run a command of iproute2; what it prints.

    Raises:
        NetworkError: it has failed.
    """
    line = list(map(str, arguments))
    done = subprocess.run(line, capture_output=True, text=True, timeout=PATIENCE_S)
    if done.returncode != 0:
        raise NetworkError(f"{' '.join(line)}: {done.stderr.strip()}")
    return done.stdout


def left() -> list[str]:
    """The namespaces of this process that are there."""
    return [line for line in command("ip", "netns", "list").splitlines() if line.startswith(_PREFIX)]


@dataclass(frozen=True)
class Place:
    """Where one participant is."""

    name: str
    """A robot's id or ``WORLD``."""

    @property
    def namespace(self) -> str:
        return _PREFIX + self.name

    @property
    def address(self) -> str:
        return f"10.77.0.{HOSTS[self.name]}"

    @property
    def link_local(self) -> str:
        return f"fe80::{HOSTS[self.name]}"

    def prefix(self) -> Sequence[str]:
        """To put before a command that shall run here."""
        return ("ip", "netns", "exec", self.namespace)

    @contextmanager
    def inside(self) -> Iterator[None]:
        """The thread is here; sockets that it opens stay here."""
        with open("/proc/thread-self/ns/net") as home, open(f"/run/netns/{self.namespace}") as here:
            _enter(here.fileno())
            try:
                yield
            finally:
                _enter(home.fileno())

    def socket(self, family: int, kind: int, protocol: int = 0) -> socket.socket:
        """A socket here, wherever it is used."""
        with self.inside():
            return socket.socket(family, kind, protocol)

    def interface_index(self) -> int:
        """Of its interface, which IPv6 wants with a link-local address."""
        with self.inside():
            return socket.if_nametoindex(INTERFACE)

    def set(self, setting: str, value: int) -> None:
        """Change a setting of the kernel here, such as ``ipv4/ip_forward``."""
        with self.inside():
            (Path("/proc/sys/net") / setting).write_text(str(value))

    def knows(self, other: "Place") -> bool:
        """Whether ARP has found the other's hardware address."""
        neighbour = command("ip", "-n", self.namespace, "neigh", "show", "to", other.address)
        return "lladdr" in neighbour


def _enter(namespace: int) -> None:
    # os.setns is only there from Python 3.12 on.
    if _LIBC.setns(namespace, _CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "setns")


class Network:
    """A world and three robots on one bridge; gone after the block, and after a set-up that fails.

    Args:
        isolated: whether the robots' ports of the bridge are: they then pass nothing to one another.
    """

    def __init__(self, *, isolated: bool) -> None:
        self.isolated = isolated
        self.world = Place(WORLD)
        self.robots = tuple(Place(name) for name in HOSTS if name != WORLD)
        self.places = (self.world, *self.robots)

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            for name in (BRIDGE, *HOSTS):
                command("ip", "netns", "add", _PREFIX + name)
                undo.callback(command, "ip", "netns", "delete", _PREFIX + name)
            # Without snooping the bridge passes on all multicast, as a simple switch does.
            self._link("add", BRIDGE, "type", "bridge", "mcast_snooping", 0)
            self._link("set", BRIDGE, "up")
            for place in self.places:
                self._connect(place)
            self._undo = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def _link(self, *arguments: object) -> None:
        command("ip", "-n", _PREFIX + BRIDGE, "link", *arguments)

    def _connect(self, place: Place) -> None:
        port = f"to-{place.name}"
        self._link("add", port, "type", "veth", "peer", "name", INTERFACE, "netns", place.namespace)
        self._link("set", port, "master", BRIDGE, "up")
        if self.isolated and place != self.world:
            command("bridge", "-n", _PREFIX + BRIDGE, "link", "set", "dev", port, "isolated", "on")
        own = ("ip", "-n", place.namespace)
        command(*own, "link", "set", "lo", "up")
        command(*own, "link", "set", INTERFACE, "addrgenmode", "none", "up")
        command(*own, "address", "add", f"{place.address}/24", "brd", BROADCAST_ADDRESS, "dev", INTERFACE)
        # Without nodad it could not be used for a second.
        command(*own, "address", "add", f"{place.link_local}/64", "dev", INTERFACE, "nodad")
        place.set("ipv4/ip_forward", 0)  # a new namespace may inherit that of the machine
