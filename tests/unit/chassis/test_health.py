"""The watch port on real sockets, with clients that behave and others that do not."""

import contextlib
import http.client
import socket
import threading
import time
from pathlib import Path

import pytest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.parser import text_string_to_metric_families

import chassis.health
from chassis import healthy
from chassis.health import (
    LONGEST_SILENCE_S,
    MOST_A_SECOND,
    MOST_AT_A_TIME,
    PATIENCE_S,
    VitalSigns,
    watch_port,
)
from chassis.healthy import HOST, LIVE, METRICS, VARIABLE, ask


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


def get(port, path, method="GET"):
    connection = http.client.HTTPConnection(HOST, port, timeout=30.0)
    with contextlib.closing(connection):
        connection.request(method, path)
        answer = connection.getresponse()
        return answer.status, answer.headers["Content-Type"], answer.read().decode()


def test_a_process_is_live_while_its_loop_gives_signs_of_life_and_ready_while_it_works(
    service, port, monkeypatch, capsys
):
    """As the health check of a container asks, at the port that the environment names."""

    def says(*questions):
        return healthy.main([*questions]), capsys.readouterr().out.strip()

    monkeypatch.setenv(VARIABLE, str(port))
    assert says("live") == (1, "not live: it has just been started")
    service.beat()
    service.wants("it waits for a world")
    service.clock.now_s += LONGEST_SILENCE_S + 1.0  # a start may take longer than a turn of the loop
    assert says("live") == (0, "live")
    assert says() == (1, "not ready: it waits for a world")
    service.works("drives")
    service.beat()
    service.up()
    assert says("ready") == (0, "ready")
    service.clock.now_s += LONGEST_SILENCE_S + 1.0
    assert says("live") == (1, "not live: no sign of life for 11 s")
    assert says() == (1, "not ready: no sign of life for 11 s")
    service.beat()
    assert says("live") == (0, "live")
    service.ends()
    assert says() == (1, "not ready: it ends")


def test_metrics_are_told_and_anything_else_is_refused(port):
    status, content_type, text = get(port, METRICS)
    assert (status, content_type.partition(";")[0]) == (200, "text/plain")
    [family] = text_string_to_metric_families(text)
    assert [(sample.name, sample.value) for sample in family.samples] == [("unspoken_test", 4.5)]
    assert get(port, "/etc/passwd")[0] == 404
    assert get(port, LIVE, method="POST")[0] == 501


def test_only_this_machine_is_answered(port):
    sockets = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    bound = [fields[1] for fields in sockets if fields[3] == "0A"]
    assert [address for address in bound if address.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]


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


def test_a_client_that_stays_silent_is_given_up(port, monkeypatch):
    monkeypatch.setattr(chassis.health._Answers, "timeout", 0.1)
    with socket.create_connection((HOST, port)) as client:
        client.settimeout(30.0)
        assert client.recv(100) == b""


@pytest.mark.parametrize("said", [b"\0" * 70_000, b"GET " + 70_000 * b"a", b"x: y\r\n" * 9000])
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
    begin_s, count = time.monotonic(), 8
    for _ in range(count):
        assert get(port, METRICS)[0] == 200
    assert time.monotonic() - begin_s > 0.9 * (count - 1) / MOST_A_SECOND
