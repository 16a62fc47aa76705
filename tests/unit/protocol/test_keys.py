"""What a key tells, which subscription reaches it, judged by Zenoh itself, and which names make no key."""

import pytest
import zenoh

from protocol.keys import BENCH_NAME, WORLD_NAME, Keys, checked_name

KEYS = Keys("run-1")
OF_ROBOTS = ("pose", "command", "alive", "mind")
WRONG_NAMES = ["", "a b", "a\n", "a" * 33, "a/b", "*", "a$*", "a?", "#a", "-a", "ä", WORLD_NAME, BENCH_NAME]


@pytest.mark.parametrize("robot", ["a", "Robot_2-b", "x" * 32])
def test_a_key_tells_its_kind_and_its_robot_and_is_reached_by_its_subscriptions(robot: str) -> None:
    everything, everyone = zenoh.KeyExpr(KEYS.everything), zenoh.KeyExpr(KEYS.everyone_alive)
    for keys in (KEYS, Keys("run-2")):
        for kind in (*OF_ROBOTS, "scene_for"):
            key = getattr(keys, kind)(robot)
            assert (keys.kind_of(key), keys.robot_of(key)) == (kind.removesuffix("_for"), robot)
            assert everything.intersects(zenoh.KeyExpr(key)) == (keys is KEYS)
            assert everyone.intersects(zenoh.KeyExpr(key)) == (keys is KEYS and kind == "alive")
        assert (keys.kind_of(keys.scene), keys.kind_of(keys.truth)) == ("scene", "truth")
        assert everything.intersects(zenoh.KeyExpr(keys.truth)) == (keys is KEYS)


@pytest.mark.parametrize("wrong", WRONG_NAMES)
def test_a_name_that_is_no_single_chunk_of_a_key_is_refused(wrong: str) -> None:
    for build in (Keys, KEYS.pose, KEYS.command, KEYS.alive, KEYS.mind, KEYS.scene_for):
        with pytest.raises(ValueError, match="should match pattern"):
            build(wrong)
    with pytest.raises(ValueError, match="1 to 32 letters"):
        checked_name(wrong)
