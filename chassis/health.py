"""How a process is, as its loop reports it, and the port at which that can be watched.

The watch port answers ``/live``, ``/ready`` and ``/metrics`` over HTTP, for this machine only, on threads of
its own. It cannot hold up the loop that it reports on: a client that is slow loses its place to the next one,
and no more than ``MOST_A_SECOND`` are served.
"""

import contextlib
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer, ThreadingMixIn
from typing import Any

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import choose_encoder

from chassis.healthy import HOST, LIVE, METRICS, READY
from chassis.lean import structlog
from chassis.process import LONGEST_START_S, ServiceManager
from chassis.refusal import ExitStatus, Refusal

LONGEST_SILENCE_S = 10.0
"""A loop that has given no sign of life for longer hangs."""

PATIENCE_S = 2.0
"""For each piece of a request, and for the client to take the answer."""
MOST_AT_A_TIME = 16
"""Clients; one more, and the first of them has to go."""
MOST_A_SECOND = 20
"""Clients, so that asking without end costs the process little."""
BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Buckets of histograms, from a fast phase to a decision by the reference solver."""

Values = float | Mapping[str, float] | Mapping[tuple[str, str], float]
"""Of a metric: one value, or one by label or by two labels."""

log = structlog.get_logger("watch")


def gauge(name: str, meaning: str, values: Values, *labels: str) -> Metric:
    """A metric that goes up and down, with its present values."""
    return _filled(GaugeMetricFamily, name, meaning, values, labels)


def counter(name: str, meaning: str, values: Values, *labels: str) -> Metric:
    """A metric that only grows, with its present values."""
    return _filled(CounterMetricFamily, name, meaning, values, labels)


def _filled(
    kind: type[GaugeMetricFamily] | type[CounterMetricFamily],
    name: str,
    meaning: str,
    values: Values,
    labels: tuple[str, ...],
) -> Metric:
    family = kind(name, meaning, labels=labels)
    for at, value in values.items() if isinstance(values, Mapping) else (((), values),):
        family.add_metric([at] if isinstance(at, str) else at, float(value))
    return family


class VitalSigns:
    """The loop of a process gives its signs of life here; any thread may ask how it is.

    What is watched has metrics beside: it overrides :meth:`collect`.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self.now_s = now_s
        self._manager = ServiceManager()
        self._beaten_s: float | None = None
        self._longest_s = LONGEST_START_S
        self._wanting: str | None = "it has just been started"

    def beat(self) -> None:
        """The loop goes on; called by the loop itself, at least every ``BEAT_S`` while it waits."""
        self._beaten_s = self.now_s()
        self._manager.alive()

    def wants(self, what: str) -> None:
        """The process cannot do yet, or not any more, what it is there for; why, for people."""
        if what != self._wanting:
            self._wanting = what
            self._manager.tell(STATUS=what)

    def works(self, how: str) -> None:
        """The process does what it is there for; how, for people."""
        self._wanting = None
        self._manager.tell(STATUS=how)

    def up(self) -> None:
        """The start is over: whoever waits for this process need not wait any more."""
        self._longest_s = LONGEST_SILENCE_S
        self._manager.up()

    def ends(self) -> None:
        """The process is about to end in order."""
        self.wants("it ends")
        self._manager.tell(STOPPING="1")

    def why_not_live(self) -> str | None:
        """What speaks against the loop going on; None: nothing."""
        if self._beaten_s is None:
            return self._wanting
        silent_s = self.now_s() - self._beaten_s
        return f"no sign of life for {silent_s:.0f} s" if silent_s > self._longest_s else None

    def why_not_ready(self) -> str | None:
        """What keeps the process from what it is there for; None: nothing."""
        return self.why_not_live() or self._wanting

    def collect(self) -> Iterable[Metric]:
        """The metrics with their present values."""
        return ()


@contextlib.contextmanager
def watch_port(watched: VitalSigns, port: int | None) -> Iterator[int | None]:
    """Answer at a port of the loopback address for as long as the block lasts.

    Args:
        watched: what is reported on.
        port: 0 for a free one; None: nobody watches.

    Yields:
        The port.

    Raises:
        Refusal: it cannot be used.
    """
    if port is None:
        yield None
        return
    try:
        server = _Server(port, watched)
    except OSError as error:
        raise Refusal(
            f"the watch port {port} on {HOST} cannot be used: {error.strerror}; choose another one with "
            "--watch-port, or 0 for one that is free",
            ExitStatus.FAILED,
        ) from error
    thread = threading.Thread(target=server.serve_forever, name="watch", daemon=True)
    thread.start()
    used = int(server.server_address[1])
    log.info("can be watched", address=f"http://{HOST}:{used}{METRICS}")
    try:
        yield used
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingMixIn, TCPServer):
    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = MOST_AT_A_TIME

    def __init__(self, port: int, watched: VitalSigns) -> None:
        super().__init__((HOST, port), _Answers)
        self.watched = watched
        self._lock = threading.Lock()
        self._places: list[Any] = []

    def service_actions(self) -> None:
        """Called after each client: the pause bounds how many come in a second."""
        time.sleep(1.0 / MOST_A_SECOND)

    def process_request(self, request: Any, client_address: Any) -> None:
        """A client has come; whoever has been there for longest makes room."""
        with self._lock:
            while len(self._places) >= MOST_AT_A_TIME:
                with contextlib.suppress(OSError):  # the client has gone by itself
                    self._places.pop(0).shutdown(socket.SHUT_RDWR)  # wakes the thread that waits for it
            self._places.append(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """A client has been answered, or given up."""
        with self._lock:
            if request in self._places:
                self._places.remove(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """What a client does to its connection is its own affair; what goes wrong here is logged."""
        error = sys.exception()
        if not isinstance(error, OSError):
            log.error("could not answer", exc_info=error)


class _Answers(BaseHTTPRequestHandler):
    server: _Server
    timeout = PATIENCE_S
    server_version, sys_version = "unspoken", ""

    def do_GET(self) -> None:
        watched = self.server.watched
        if self.path == LIVE:
            self._say_whether("live", watched.why_not_live)
        elif self.path == READY:
            self._say_whether("ready", watched.why_not_ready)
        elif self.path == METRICS:
            encode, content_type = choose_encoder(self.headers.get("Accept", ""))
            self._say(HTTPStatus.OK, encode(watched), content_type)
        else:
            self._say(HTTPStatus.NOT_FOUND, f"{LIVE}, {READY} or {METRICS} is expected\n".encode())

    def _say_whether(self, what: str, why_not: Callable[[], str | None]) -> None:
        if why := why_not():
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, f"not {what}: {why}\n".encode())
        else:
            self._say(HTTPStatus.OK, f"{what}\n".encode())

    def _say(self, status: HTTPStatus, body: bytes, content_type: str = "text/plain; charset=utf-8") -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """No line for a request."""
