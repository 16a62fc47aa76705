"""The policy as a table: by what is granted, nothing that one robot says or does can reach another."""

import json
from itertools import permutations
from typing import Any

import zenoh
from hypothesis import given
from hypothesis import strategies as st

from protocol.keys import BENCH_NAME, Keys
from protocol.policy import access_control, rights_of
from protocol.session import world_session

KEYS = Keys("run")
ROBOTS = st.lists(st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", fullmatch=True), unique=True, max_size=6)


def overlap(ones: tuple[str, ...], others: tuple[str, ...]) -> bool:
    """Whether any key of these is one of those, wildcards considered."""
    return any(zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other)) for one in ones for other in others)


@given(ROBOTS)
def test_no_robot_can_read_be_told_of_or_ask_for_what_another_can_do(robots: list[str]) -> None:
    rights = rights_of(KEYS, robots)
    for one, other in permutations(robots, 2):
        done = rights[one].says + rights[one].stands
        assert not overlap(done, rights[other].reads + rights[other].asks + rights[other].sees)
        # None asks under another's name, so that what a robot says when it joins is its own word.
        assert not overlap(rights[one].asks, rights[other].asks)
        # Whether somebody listens is told of the world's and the bench's subscriptions only.
        assert not set(rights[one].reads) & set(rights[other].readers)


def granted(proof: Any) -> list[tuple[str, str, str, tuple[str, ...]]]:
    """Subject, message, flow and keys of every rule, by way of Zenoh's own reading of the configuration."""
    control = access_control(rights_of(KEYS, ["a", "b"]), proof)
    config = json.loads(world_session("tcp/127.0.0.1:7447", control).to_zenoh().get_json("access_control"))
    assert (config["enabled"], config["default_permission"]) == (True, "deny")
    rules = {rule["id"]: rule for rule in config["rules"]}
    subjects = {subject["id"]: subject[proof] for subject in config["subjects"]}
    return [
        (name, message, *rules[rule]["flows"], tuple(rules[rule]["key_exprs"]))
        for policy in config["policies"]
        for rule in policy["rules"]
        for subject in policy["subjects"]
        for name in subjects[subject]
        for message in rules[rule]["messages"]
    ]


def test_zenoh_reads_each_right_as_these_messages_in_these_directions() -> None:
    assert granted("cert_common_names") == granted("usernames")
    assert {each[0] for each in granted("usernames")} == {"a", "b", BENCH_NAME}
    assert {each for each in granted("usernames") if each[0] == "a"} == {
        ("a", "declare_subscriber", "ingress", (KEYS.pose("a"),)),
        ("a", "put", "egress", (KEYS.pose("a"),)),
        ("a", "put", "ingress", (KEYS.command("a"), KEYS.mind("a"))),
        ("a", "declare_subscriber", "egress", (KEYS.command("a"), KEYS.everything)),
        ("a", "query", "ingress", (KEYS.scene_for("a"),)),
        ("a", "reply", "egress", (KEYS.scene_for("a"),)),
        ("a", "declare_queryable", "egress", (KEYS.scene_for("a"),)),
        ("a", "liveliness_token", "ingress", (KEYS.alive("a"),)),
    }
    assert {each for each in granted("usernames") if each[0] == BENCH_NAME} == {
        (BENCH_NAME, "declare_subscriber", "ingress", (KEYS.everything,)),
        (BENCH_NAME, "put", "egress", (KEYS.everything,)),
        (BENCH_NAME, "query", "ingress", (KEYS.scene,)),
        (BENCH_NAME, "reply", "egress", (KEYS.scene,)),
        (BENCH_NAME, "declare_queryable", "egress", (KEYS.scene,)),
        (BENCH_NAME, "declare_liveliness_subscriber", "ingress", (KEYS.everyone_alive,)),
        (BENCH_NAME, "liveliness_query", "ingress", (KEYS.everyone_alive,)),
        (BENCH_NAME, "liveliness_token", "egress", (KEYS.everyone_alive,)),
    }
