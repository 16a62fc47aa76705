"""The watch port: ``/live``, ``/ready`` and ``/metrics`` over HTTP, for this machine only.

It answers on threads of its own and cannot hold up the loop that it tells of: a client that is slow loses its
place to the next one, and no more than ``MOST_A_SECOND`` are served.
"""

import http.client
import os
import socket
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer, ThreadingMixIn
from typing import Any, Protocol

import structlog
from prometheus_client.core import Metric
from prometheus_client.exposition import choose_encoder

HOST = "127.0.0.1"
"""Watching is for this machine: nothing there asks who somebody is."""
LIVE, READY, METRICS = "/live", "/ready", "/metrics"
VARIABLE = "UNSPOKEN_WATCH_PORT"
HELP = f"Port on {HOST} at which to tell over HTTP how this process is: {LIVE}, {READY}, {METRICS}."
PATIENCE_S = 3.0


class WatchPortError(Exception):
    """A watch port that cannot be used; the text says why and what to do."""


def port_told() -> int:
    """The port that the environment tells.

    Raises:
        WatchPortError: it tells none.
    """
    told = os.environ.get(VARIABLE, "")
    if told.isdecimal() and 0 < int(told) < 2**16:
        return int(told)
    raise WatchPortError(f"{VARIABLE} is {told!r}; the port at which the process can be watched is expected")


def ask(port: int, path: str) -> tuple[bool, str]:
    """Ask a process on this machine how it is.

    Args:
        port: its watch port.
        path: ``LIVE`` or ``READY``.

    Returns:
        Whether it says yes, and what it says.

    Raises:
        WatchPortError: nobody answers.
    """
    connection = http.client.HTTPConnection(HOST, port, timeout=PATIENCE_S)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status == http.client.OK, answer.read(1000).decode(errors="replace").strip()
    except (OSError, http.client.HTTPException) as error:
        raise WatchPortError(f"nobody answers at http://{HOST}:{port}{path}: {error}") from error
    finally:
        connection.close()


PATIENCE_S_watching = 2.0
"""For each piece of a request, and for the client to take the answer."""
MOST_AT_A_TIME = 16
"""Clients; one more, and the first of them has to go."""
MOST_A_SECOND = 20
"""Clients, so that asking without end costs the process little."""

log = structlog.get_logger("watch")


class Watched(Protocol):
    """What is watched; asked on other threads than that of its loop."""

    def why_not_live(self) -> str | None:
        """What speaks against its loop going on; None: nothing."""

    def why_not_ready(self) -> str | None:
        """What keeps it from what it is there for; None: nothing."""

    def collect(self) -> Iterable[Metric]:
        """Its metrics, with their present values."""


@contextmanager
def watch_port(watched: Watched, port: int) -> Iterator[int]:
    """Answer at a port of the loopback address for as long as the block lasts.

    Args:
        watched: of whom to tell.
        port: 0 for a free one.

    Yields:
        The port.

    Raises:
        WatchPortError: it cannot be used.
    """
    try:
        server = _Server(port, watched)
    except OSError as error:
        raise WatchPortError(
            f"the watch port {port} on {HOST} cannot be used: {error.strerror}; choose another one with "
            "--watch-port, or 0 for one that is free"
        ) from error
    thread = threading.Thread(target=server.serve_forever, name="watch", daemon=True)
    thread.start()
    log.info("can be watched", address=f"http://{HOST}:{server.port}{METRICS}")
    try:
        yield server.port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingMixIn, TCPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = MOST_AT_A_TIME

    def __init__(self, port: int, watched: Watched) -> None:
        super().__init__((HOST, port), _Answers)
        self.watched = watched
        self._lock = threading.Lock()
        self._places: list[Any] = []

    @property
    def port(self) -> int:
        """At which it answers."""
        return int(self.server_address[1])

    def service_actions(self) -> None:
        """Called after each client: the pause bounds how many come in a second."""
        time.sleep(1.0 / MOST_A_SECOND)

    def process_request(self, request: Any, client_address: Any) -> None:
        """A client has come; whoever has been there for longest makes room."""
        with self._lock:
            while len(self._places) >= MOST_AT_A_TIME:
                _cut_off(self._places.pop(0))
            self._places.append(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """A client has been answered, or given up."""
        with self._lock:
            if request in self._places:
                self._places.remove(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """What a client does to its connection is its own affair; what goes wrong here is told."""
        error = sys.exception()
        if not isinstance(error, OSError):
            log.error("could not answer", exc_info=error)


class _Answers(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE_S_watching
    server_version, sys_version = "unspoken", ""

    def do_GET(self) -> None:
        watched = self.server.watched
        if self.path == LIVE:
            self._tell_whether(watched.why_not_live(), "live")
        elif self.path == READY:
            self._tell_whether(watched.why_not_ready(), "ready")
        elif self.path == METRICS:
            encode, content_type = choose_encoder(self.headers.get("Accept", ""))
            self._say(HTTPStatus.OK, content_type, encode(watched))
        else:
            expected = f"{LIVE}, {READY} or {METRICS} is expected\n"
            self._say(HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", expected.encode())

    def _tell_whether(self, why_not: str | None, what: str) -> None:
        status = HTTPStatus.OK if why_not is None else HTTPStatus.SERVICE_UNAVAILABLE
        line = what if why_not is None else f"not {what}: {why_not}"
        self._say(status, "text/plain; charset=utf-8", f"{line}\n".encode())

    def _say(self, status: HTTPStatus, content_type: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """No line for a request."""


def _cut_off(connection: socket.socket) -> None:
    """Wake the thread that waits for this client."""
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:  # the client has gone by itself
        return
