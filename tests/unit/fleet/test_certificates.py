"""Certificates; hosts as people write them; and devices by the names of their folders."""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from chassis.refusal import Refusal
from fleet.keys.authority import Authority, Device, checked_host, folder_of, hosts_in, name_of
from protocol.keys import BENCH_NAME, WORLD_NAME

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)


def test_serial_numbers_keys_and_the_names_of_authorities_are_never_the_same() -> None:
    authority, other = Authority.new(NOW, 300), Authority.new(NOW, 300)
    assert authority.certificate.subject != other.certificate.subject
    issued = [authority.issue(Device("7"), NOW, 30) for _ in range(3)]
    assert len({each.certificate.serial_number for each in issued}) == 3
    assert len({each.key_pem for each in issued}) == 3


def test_no_certificate_outlasts_its_authority() -> None:
    authority = Authority.new(NOW, 300)
    authority.issue(Device("7"), NOW, 300)
    with pytest.raises(Refusal, match=r"after their authority, which expires on .*; --days 300 is the most"):
        authority.issue(Device("7"), NOW, 301)
    with pytest.raises(Refusal, match="make new keys for everybody with 'unspoken keys create'"):
        authority.issue(Device("7"), NOW + timedelta(days=299.5), 1)


LABELS = st.text("aZ09_-", min_size=1, max_size=63).filter(lambda text: text[0] != "-")
HOST_NAMES = st.lists(LABELS, min_size=1, max_size=4).map(".".join)


@settings(max_examples=15)
@given(st.sets(HOST_NAMES.filter(lambda text: not text[-1].isdigit()) | st.ip_addresses(v=4).map(str)))
@example({"lab.example", "my_world", "a" * 63, "7.example"})
def test_hosts_are_found_again_in_the_worlds_certificate(hosts: set[str]) -> None:
    device = Device(WORLD_NAME, tuple(map(checked_host, hosts)))
    assert set(hosts_in(Authority.new(NOW, 300).issue(device, NOW, 30).certificate)) == hosts


NO_HOSTS = ["", " ", "a b", "tls/lab:7447", "lab:7447", "lab.", ".lab", "a..b", "-a", "1.2.3", "300.1.1.1"]
NO_HOSTS += ["ä", "*.lab", "a" * 64, "a\n", "@a"]


@pytest.mark.parametrize("text", NO_HOSTS)
def test_what_is_no_host_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="a host name or an IPv4 address is expected"):
        checked_host(text)


@pytest.mark.parametrize("text", ["::1", "fe80::1%eth0"])
def test_an_ipv6_address_is_refused_with_the_reason(text: str) -> None:
    with pytest.raises(ValueError, match="Zenoh connects to no IPv6 address"):
        checked_host(text)


@pytest.mark.parametrize("name", [WORLD_NAME, BENCH_NAME, "7", "world", "bench", "authority", "Robot-1_x"])
def test_every_name_has_a_folder_of_its_own(name: str) -> None:
    assert name_of(folder_of(name)) == name


@pytest.mark.parametrize(
    "folder", ["authority", "robot-", "robot-@world", "robot-a b", ".issued-x", "@world"]
)
def test_other_folders_are_nobodys(folder: str) -> None:
    assert name_of(folder) is None
