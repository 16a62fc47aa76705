"""The watch port on real sockets, with clients that behave and others that do not."""

import contextlib
import http.client
import os
import socket
import subprocess
import sys
import threading
import time

import pytest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.parser import text_string_to_metric_families

from chassis.health import LONGEST_SILENCE_S, VitalSigns
from chassis.healthy import HOST, LIVE, METRICS, READY, ask
from chassis.refusal import Refusal
from chassis.watching import MOST_A_SECOND, MOST_AT_A_TIME, PATIENCE_S, watch_port


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


class Service(VitalSigns):
    """A process that is watched."""

    def __init__(self):
        self.clock = Clock()
        super().__init__(now_s=self.clock)

    def collect(self):
        yield GaugeMetricFamily("unspoken_test", "Of a test.", value=4.5)


@pytest.fixture
def service():
    return Service()


@pytest.fixture
def port(service):
    with watch_port(service, 0) as port:
        yield port


def get(port, path, method="GET", **headers):
    connection = http.client.HTTPConnection(HOST, port, timeout=30.0)
    with contextlib.closing(connection):
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers["Content-Type"], answer.read().decode()


def test_a_process_is_live_as_long_as_its_loop_gives_signs_of_life(service, port):
    assert ask(str(port), LIVE) == (False, "not live: it has just been started")
    service.beat()
    service.up()
    assert ask(str(port), LIVE) == (True, "live")
    service.clock.now_s += LONGEST_SILENCE_S + 1.0
    assert ask(str(port), LIVE) == (False, "not live: no sign of life for 11 s")
    service.beat()
    assert ask(str(port), LIVE) == (True, "live")


def test_a_start_may_take_longer_than_a_turn_of_the_loop(service, port):
    service.beat()
    service.clock.now_s += LONGEST_SILENCE_S + 1.0
    assert ask(str(port), LIVE) == (True, "live")


def test_a_process_is_ready_when_it_is_live_and_works(service, port):
    service.beat()
    service.wants("it waits for a world")
    assert ask(str(port), READY) == (False, "not ready: it waits for a world")
    service.works("drives")
    service.up()
    assert ask(str(port), READY) == (True, "ready")
    service.clock.now_s += LONGEST_SILENCE_S + 1.0
    assert ask(str(port), READY) == (False, "not ready: no sign of life for 11 s")
    service.beat()
    service.ends()
    assert ask(str(port), READY) == (False, "not ready: it ends")


@pytest.mark.parametrize("accept", ["", "text/plain", "application/openmetrics-text; version=1.0.0"])
def test_metrics_come_in_the_format_that_is_asked_for(port, accept):
    status, content_type, text = get(port, METRICS, Accept=accept)
    assert status == 200
    assert content_type.startswith(accept.partition(";")[0] or "text/plain")
    if "openmetrics" not in accept:
        [family] = text_string_to_metric_families(text)
        assert [(sample.name, sample.value) for sample in family.samples] == [("unspoken_test", 4.5)]


def test_anything_else_is_refused(port):
    assert get(port, "/")[0] == 404
    assert f"{LIVE}, {READY} or {METRICS}" in get(port, "/etc/passwd")[2]
    assert get(port, LIVE, method="POST")[0] == 501


def test_only_this_machine_is_answered(port):
    listening = subprocess.run(["cat", "/proc/net/tcp"], capture_output=True, text=True, check=True).stdout
    bound = [line.split()[1] for line in listening.splitlines()[1:] if line.split()[3] == "0A"]
    assert [address for address in bound if address.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]


def test_a_port_in_use_is_a_clear_error(service, port):
    with pytest.raises(Refusal, match=f"watch port {port} on 127.0.0.1 cannot be used: Address al"):
        watch_port(service, port).__enter__()


def test_clients_that_say_nothing_lose_their_places_to_others(port):
    with contextlib.ExitStack() as open_:
        silent = [
            open_.enter_context(socket.create_connection((HOST, port))) for _ in range(2 * MOST_AT_A_TIME)
        ]
        for client in silent:
            client.sendall(b"GET /li")
        begin_s = time.monotonic()
        assert get(port, METRICS)[0] == 200
        assert time.monotonic() - begin_s < PATIENCE_S
        assert threading.active_count() < MOST_AT_A_TIME + 10
        silent[0].settimeout(30.0)
        with contextlib.suppress(ConnectionResetError):
            assert silent[0].recv(100) == b""


def test_a_client_that_stays_silent_is_given_up(port):
    with socket.create_connection((HOST, port)) as client:
        client.settimeout(10 * PATIENCE_S)
        assert client.recv(100) == b""


@pytest.mark.parametrize(
    "said",
    [b"\0" * 70_000, b"GET " + 70_000 * b"a", b"GET /live HTTP/9.9\r\n\r\n", b"\r\n", b"x: y\r\n" * 9000],
)
def test_nonsense_does_no_harm(service, port, capfd, said):
    service.beat()
    with socket.create_connection((HOST, port)) as client, contextlib.suppress(OSError):
        client.sendall(said)
        client.shutdown(socket.SHUT_WR)
        while client.recv(65536):
            pass
    assert ask(str(port), LIVE) == (True, "live")
    assert "Traceback" not in capfd.readouterr().err


def test_clients_without_end_are_served_at_a_bounded_rate(port):
    begin_s, count = time.monotonic(), 20
    for _ in range(count):
        assert get(port, METRICS)[0] == 200
    assert time.monotonic() - begin_s > 0.9 * (count - 1) / MOST_A_SECOND


def test_nobody_answers_after_the_end(service):
    with watch_port(service, 0) as port:
        pass
    answers, why = ask(str(port), LIVE)
    assert not answers
    assert "nobody answers at http" in why


def healthy(*arguments, **environment):
    asked = subprocess.run(
        [sys.executable, "-m", "chassis.healthy", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    return asked.returncode, asked.stdout + asked.stderr


def test_a_health_check_asks_at_the_port_of_the_environment(service, port):
    told = {"UNSPOKEN_WATCH_PORT": str(port)}
    service.beat()
    assert healthy(**told) == (1, "not ready: it has just been started\n")
    assert healthy("live", **told) == (0, "live\n")
    service.works("drives")
    assert healthy(**told) == healthy("ready", **told) == (0, "ready\n")


def test_a_health_check_fails_in_one_line_where_nobody_answers():
    with socket.create_server((HOST, 0)) as free:
        port = free.getsockname()[1]
    status, told = healthy(UNSPOKEN_WATCH_PORT=str(port))
    assert status == 1
    assert told.startswith(f"nobody answers at http://127.0.0.1:{port}/ready")
    assert told.count("\n") == 1


def test_a_health_check_that_is_told_nothing_says_what_it_needs():
    for told in ("", "here", "0", "70000"):
        status, said = healthy(UNSPOKEN_WATCH_PORT=told)
        assert (status, said.count("\n")) == (1, 1)
        assert "the port at which the process can be watched is expected" in said
    assert healthy("reday", UNSPOKEN_WATCH_PORT="1")[0] == 2
