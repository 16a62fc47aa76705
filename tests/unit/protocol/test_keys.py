"""Every key of the bus, and who is reached by which subscription, judged by Zenoh itself."""

import pytest
import zenoh

from protocol.keys import BENCH_NAME, WORLD_NAME, Keys, checked_name

KEYS = Keys("run-1")
ALL_KEYS = {
    "pose": KEYS.pose("a"),
    "command": KEYS.command("a"),
    "alive": KEYS.alive("a"),
    "mind": KEYS.mind("a"),
    "scene": KEYS.scene,
    "scene for a": KEYS.scene_for("a"),
    "truth": KEYS.truth,
}
OF_ROBOTS = ("pose", "command", "alive", "mind")
WRONG_NAMES = ["", "a b", "a\n", "a" * 33, "a/b", "*", "a$*", "a?", "#a", "-a", "ä", WORLD_NAME, BENCH_NAME]


def test_the_keys_are_these() -> None:
    assert ALL_KEYS == {
        "pose": "unspoken/run-1/pose/a",
        "command": "unspoken/run-1/command/a",
        "alive": "unspoken/run-1/alive/a",
        "mind": "unspoken/run-1/mind/a",
        "scene": "unspoken/run-1/scene",
        "scene for a": "unspoken/run-1/scene/a",
        "truth": "unspoken/run-1/truth",
    }
    assert KEYS.everyone_alive == "unspoken/run-1/alive/*"
    assert KEYS.everything == "unspoken/run-1/**"


@pytest.mark.parametrize("robot", ["a", "7", "Robot_2-b", "x" * 32])
def test_a_key_tells_its_kind_and_its_robot(robot: str) -> None:
    assert {KEYS.kind_of(key) for key in ALL_KEYS.values()} == {*OF_ROBOTS, "scene", "truth"}
    for kind in (*OF_ROBOTS, "scene_for"):
        key = getattr(KEYS, kind)(robot)
        assert (KEYS.kind_of(key), KEYS.robot_of(key)) == (kind.removesuffix("_for"), robot)


def reached(subscription: str) -> set[str]:
    """The kinds of keys of robots a and b in this run, and of a in another, that a subscription receives."""
    other_run = Keys("run-2")
    candidates = {
        **ALL_KEYS,
        **{f"{kind} of b": getattr(KEYS, kind)("b") for kind in OF_ROBOTS},
        **{f"{kind} elsewhere": getattr(other_run, kind)("a") for kind in OF_ROBOTS},
        "scene elsewhere": other_run.scene,
        "truth elsewhere": other_run.truth,
    }
    return {
        name for name, key in candidates.items() if zenoh.KeyExpr(subscription).intersects(zenoh.KeyExpr(key))
    }


def test_each_subscription_reaches_what_it_is_for_and_nothing_else() -> None:
    assert reached(KEYS.everyone_alive) == {"alive", "alive of b"}
    assert reached(KEYS.pose("a")) == {"pose"}
    assert reached(KEYS.everything) == {*ALL_KEYS, *(f"{kind} of b" for kind in OF_ROBOTS)}


@pytest.mark.parametrize("wrong", WRONG_NAMES)
def test_a_name_that_is_no_single_chunk_of_a_key_is_refused(wrong: str) -> None:
    for build in (Keys, KEYS.pose, KEYS.command, KEYS.alive, KEYS.mind, KEYS.scene_for):
        with pytest.raises(ValueError, match="should match pattern"):
            build(wrong)
    with pytest.raises(ValueError, match="1 to 32 letters"):
        checked_name(wrong)
