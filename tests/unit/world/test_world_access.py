"""Whom a world lets in: what it refuses to start with, and what it warns of."""

import pytest
import structlog
from structlog.testing import capture_logs

from chassis.refusal import Refusal
from protocol.identity import new_passwords, write_users
from protocol.keys import BENCH_NAME, Keys
from world.access import SPARE_SESSIONS, Access

KEYS = Keys("run")
ROBOTS = ("1", "2")
HERE = "tcp/127.0.0.1:7447"
NETWORK = "tcp/0.0.0.0:7447"


@pytest.fixture
def users(tmp_path):
    path = tmp_path / "users"
    write_users(path, new_passwords([BENCH_NAME, *ROBOTS]))
    return path


def session(access):
    """The settings, and what was warned of."""
    with capture_logs() as log:
        settings = access.session(KEYS, ROBOTS, structlog.get_logger())
    return settings, [entry["event"] for entry in log if entry["log_level"] == "warning"]


def test_with_passwords_the_policy_is_enforced_and_nothing_is_warned_of(users):
    settings, warnings = session(Access(listen=HERE, users=users))
    assert warnings == []
    subjects = settings.config["access_control"]["subjects"]
    assert {subject["usernames"] for subject in subjects} == {("1",), ("2",), (BENCH_NAME,)}
    transport = settings.config["transport"]
    assert transport["auth"]["usrpwd"]["dictionary_file"] == str(users)
    assert transport["unicast"]["max_sessions"] == 2 * len(ROBOTS) + SPARE_SESSIONS


def test_a_world_that_others_can_reach_needs_keys_or_to_be_told_and_an_open_one_says_so(users):
    for access in (Access(listen=NETWORK), Access(listen=NETWORK, users=users)):
        with pytest.raises(Refusal, match=r"can be reached from other machines.*--keys.*--insecure"):
            session(access)
    for access, closed, warning in (
        (Access(listen=NETWORK, users=users, insecure=True), True, "insecure: anyone on the network can"),
        (Access(listen=HERE), False, "no policy: whoever connects may"),
    ):
        settings, (warned,) = session(access)
        assert ("access_control" in settings.config) == closed
        assert warned.startswith(warning)


def test_what_goes_not_together_is_refused(tmp_path, users):
    one, tls = tmp_path / "one", "tls/127.0.0.1:7447"
    write_users(one, new_passwords(["1"]))
    for options, told in (
        ({"listen": HERE, "users": one}, "no password for robot 2;"),
        ({"listen": HERE, "keys": tmp_path}, "is not encrypted"),
        ({"listen": tls, "users": users}, "the folder with the keys of this device is expected in --keys"),
        ({"listen": tls, "keys": tmp_path / "none"}, "there is no such folder"),
        ({"listen": tls, "users": users, "keys": tmp_path}, "--users or --keys is expected"),
    ):
        with pytest.raises(Refusal, match=told):
            session(Access(**options))
