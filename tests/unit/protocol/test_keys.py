"""Every key of the bus, and who is reached by which subscription, judged by Zenoh itself."""

import pytest
import zenoh

from protocol.keys import Keys

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
WRONG_NAMES = [
    "",
    "a/b",
    "/a",
    "*",
    "**",
    "a*",
    "a$*",
    "a?",
    "#a",
    "@a",
    "a b",
    "a\n",
    "-a",
    "_a",
    "ä",
    "a" * 33,
]


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


@pytest.mark.parametrize("kind", ALL_KEYS)
def test_a_key_tells_its_kind(kind: str) -> None:
    assert KEYS.kind_of(ALL_KEYS[kind]) == kind.removesuffix(" for a")


@pytest.mark.parametrize("kind", ["pose", "command", "alive", "mind", "scene_for"])
@pytest.mark.parametrize("robot", ["a", "7", "Robot_2-b", "x" * 32])
def test_a_robots_key_tells_the_robot(kind: str, robot: str) -> None:
    assert KEYS.robot_of(getattr(KEYS, kind)(robot)) == robot


def reached(subscription: str) -> set[str]:
    """The kinds of keys of robots a and b in this run, and of a in another, that a subscription receives."""
    other_run = Keys("run-2")
    candidates = {
        **ALL_KEYS,
        **{f"{kind} of b": getattr(KEYS, kind)("b") for kind in ("pose", "command", "alive", "mind")},
        **{
            f"{kind} elsewhere": getattr(other_run, kind)("a")
            for kind in ("pose", "command", "alive", "mind")
        },
        "scene elsewhere": other_run.scene,
        "truth elsewhere": other_run.truth,
    }
    return {
        name for name, key in candidates.items() if zenoh.KeyExpr(subscription).intersects(zenoh.KeyExpr(key))
    }


def test_the_worlds_subscription_reaches_the_presence_of_each_robot_and_nothing_else() -> None:
    assert reached(KEYS.everyone_alive) == {"alive", "alive of b"}


def test_a_robots_subscription_reaches_its_own_poses_only() -> None:
    assert reached(KEYS.pose("a")) == {"pose"}


def test_the_recorder_is_reached_by_everything_of_its_run() -> None:
    of_b = {f"{kind} of b" for kind in ("pose", "command", "alive", "mind")}
    assert reached(KEYS.everything) == set(ALL_KEYS) | of_b


@pytest.mark.parametrize("wrong", WRONG_NAMES)
def test_a_name_that_is_no_single_chunk_of_a_key_is_refused(wrong: str) -> None:
    for build in (Keys, KEYS.pose, KEYS.command, KEYS.alive, KEYS.mind, KEYS.scene_for):
        with pytest.raises(ValueError, match="should match pattern"):
            build(wrong)
