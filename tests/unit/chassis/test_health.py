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
from chassis.healthy import HOST, LIVE, METRICS, READY, VARIABLE, ask
from chassis.refusal import ExitStatus, Refusal


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
    service.clock.now_s += LONGEST_SILENCE_S + 1.0  # a start may take longer than a turn of the loop
    assert ask(str(port), LIVE) == (True, "live")
    service.beat()
    service.up()
    assert ask(str(port), LIVE) == (True, "live")
    service.clock.now_s += LONGEST_SILENCE_S + 1.0
    assert ask(str(port), LIVE) == (False, "not live: no sign of life for 11 s")
    service.beat()
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


@pytest.mark.parametrize("accept", ["text/plain", "application/openmetrics-text; version=1.0.0"])
def test_metrics_come_in_the_format_that_is_asked_for(port, accept):
    status, content_type, text = get(port, METRICS, Accept=accept)
    assert status == 200
    assert content_type.startswith(accept.partition(";")[0])
    if "openmetrics" not in accept:
        [family] = text_string_to_metric_families(text)
        assert [(sample.name, sample.value) for sample in family.samples] == [("unspoken_test", 4.5)]


def test_anything_else_is_refused(port):
    assert get(port, "/")[0] == 404
    assert f"{LIVE}, {READY} or {METRICS}" in get(port, "/etc/passwd")[2]
    assert get(port, LIVE, method="POST")[0] == 501


def test_only_this_machine_is_answered(port):
    sockets = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    bound = [fields[1] for fields in sockets if fields[3] == "0A"]
    assert [address for address in bound if address.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]


def test_a_port_is_taken_as_long_as_it_is_answered(service):
    with watch_port(service, 0) as port:
        with pytest.raises(Refusal, match=f"watch port {port} on .* cannot be used: Address al") as taken:
            watch_port(service, port).__enter__()
        assert taken.value.status is ExitStatus.FAILED
    answers, why = ask(str(port), LIVE)
    assert not answers
    assert "nobody answers at http" in why


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


@pytest.mark.parametrize(
    "said",
    [b"\0" * 70_000, b"GET " + 70_000 * b"a", b"GET /live HTTP/9.9\r\n\r\n", b"x: y\r\n" * 9000],
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
    begin_s, count = time.monotonic(), 8
    for _ in range(count):
        assert get(port, METRICS)[0] == 200
    assert time.monotonic() - begin_s > 0.9 * (count - 1) / MOST_A_SECOND


def test_a_health_check_asks_at_the_port_of_the_environment(service, port, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, str(port))
    service.beat()
    assert (healthy.main([]), capsys.readouterr().out) == (1, "not ready: it has just been started\n")
    assert (healthy.main(["live"]), capsys.readouterr().out) == (0, "live\n")
    service.works("drives")
    assert healthy.main([]) == healthy.main(["ready"]) == 0
