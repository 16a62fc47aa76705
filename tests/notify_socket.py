"""Stands for systemd: the socket at which a service tells how it is."""

import select
import socket
import time

PATIENCE_S = 60.0


class NotifySocket:
    """Keeps what is told, each datagram as a dictionary of its assignments, with the time of its arrival."""

    def __init__(self, address):
        address = str(address)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self.environment = {"NOTIFY_SOCKET": address}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()

    def next(self, patience_s=PATIENCE_S):
        """The next datagram; None if none comes in time."""
        if not select.select([self._socket], [], [], patience_s)[0]:
            return None
        lines = self._socket.recv(65536).decode().split("\n")
        return dict(line.split("=", 1) for line in lines)

    def until(self, name, value=None):
        """Wait for this assignment; everything that was told up to it."""
        told, give_up_s = [], time.monotonic() + PATIENCE_S
        while (said := self.next(max(give_up_s - time.monotonic(), 0.0))) is not None:
            told.append(said)
            if name in said and value in (None, said[name]):
                return told
        raise AssertionError(f"{name}={value} was not told, but {told}")

    def drain(self):
        """What is there already."""
        told = []
        while (said := self.next(0.0)) is not None:
            told.append(said)
        return told
