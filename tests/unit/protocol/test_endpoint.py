"""Who can reach an endpoint."""

import pytest

from protocol.identity import is_local


@pytest.mark.parametrize(
    "endpoint",
    [
        "unixsock-stream//tmp/u/world.sock",
        "tcp/127.0.0.1:7447",
        "tcp/127.1.2.3:7447",
        "tcp/localhost:7447",
        "tcp/[::1]:7447",
        "tls/127.0.0.1:7447",
    ],
)
def test_loopback_and_sockets_in_the_file_system_are_local(endpoint: str) -> None:
    assert is_local(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/0.0.0.0:7447",
        "tcp/[::]:7447",
        "tcp/192.168.1.7:7447",
        "tcp/10.0.0.1:7447",
        "tcp/world.local:7447",
        "tls/0.0.0.0:7447",
        "udp/128.0.0.1:7447",
        "serial/dev/ttyS0",
        "nonsense",
        "",
    ],
)
def test_everything_else_may_be_reached_from_elsewhere(endpoint: str) -> None:
    assert not is_local(endpoint)
