"""What the bench records of what reaches it: of each robot, one valid message of a kind for a step."""

from typing import Any

import pytest

from fleet.record.stream import BusMessage, RefusedMind
from fleet.run.listening import MOST_WAITING_BYTES, Decoder, Mailbox, Received
from protocol.codec import MessageError, encode
from protocol.keys import Keys
from protocol.messages import Command, Message

KEYS = Keys("test")


def letter(key: str, message: Message | bytes) -> Received:
    return Received(key, message if isinstance(message, bytes) else encode(message), 1)


def command(robot: str, step: int, epoch: int) -> Command:
    return Command(epoch=epoch, robot=robot, step=step, turn_rate_radps=0.0, acceleration_mps2=0.0)


@pytest.fixture
def decoder(make_truth: Any) -> Decoder:
    """At step 5."""
    decoder = Decoder(KEYS)
    decoder.take(letter(KEYS.truth, make_truth(5, {"a": {}, "b": {}})))
    return decoder


def test_one_mind_a_step_is_kept_and_what_else_comes_is_told(decoder: Decoder, make_mind: Any) -> None:
    good = make_mind("a", 5)
    assert decoder.take(letter(KEYS.mind("a"), good)) == BusMessage(KEYS.mind("a"), good, 1)
    for message, reason in (
        (good, "answers a step again"),
        (make_mind("a", 4), "answers a step again"),
        (make_mind("a", 7), "answers another step"),
        (make_mind("b", 6), "names another robot"),
        (make_mind("a", 6).model_copy(update={"epoch": good.epoch + 1}), "answers another epoch"),
        (b"\xc1", "not a valid message"),
        (bytes(300_000), "not a valid message"),
    ):
        assert decoder.take(letter(KEYS.mind("a"), message)) == RefusedMind("a", reason)
    quick = make_mind("a", 6)  # its truth comes after its poses
    assert decoder.take(letter(KEYS.mind("a"), quick)) == BusMessage(KEYS.mind("a"), quick, 1)


def test_commands_are_kept_by_the_same_rule(decoder: Decoder, make_mind: Any) -> None:
    epoch = make_mind("a", 5).epoch
    good = command("a", 5, epoch)
    assert decoder.take(letter(KEYS.command("a"), good)) == BusMessage(KEYS.command("a"), good, 1)
    for message in (good, command("b", 6, epoch), command("a", 6, epoch + 1), command("a", 99, epoch), b""):
        assert decoder.take(letter(KEYS.command("a"), message)) is None


def test_robots_are_judged_by_themselves(decoder: Decoder, make_mind: Any) -> None:
    for robot in ("a", "b"):
        assert isinstance(decoder.take(letter(KEYS.mind(robot), make_mind(robot, 5))), BusMessage)


def test_in_a_new_world_steps_begin_anew(decoder: Decoder, make_truth: Any, make_mind: Any) -> None:
    decoder.take(letter(KEYS.mind("a"), make_mind("a", 5)))
    epoch = make_mind("a", 0).epoch + 1
    decoder.take(letter(KEYS.truth, make_truth(0, {"a": {}}).model_copy(update={"epoch": epoch})))
    anew = make_mind("a", 0).model_copy(update={"epoch": epoch})
    assert decoder.take(letter(KEYS.mind("a"), anew)) == BusMessage(KEYS.mind("a"), anew, 1)
    far = make_mind("a", 5).model_copy(update={"epoch": epoch})
    assert decoder.take(letter(KEYS.mind("a"), far)) == RefusedMind("a", "answers another step")
    assert decoder.take(letter(KEYS.truth, make_truth(6, {"a": {}}))) is None, "that world is gone"


def test_what_the_world_says_wrongly_is_an_error(decoder: Decoder) -> None:
    with pytest.raises(MessageError):
        decoder.take(letter(KEYS.truth, b"\xc1"))


def test_a_robots_flood_is_bounded_counted_and_pushes_out_nothing_of_others() -> None:
    mailbox, large = Mailbox(), bytes(200_000)
    for _ in range(100):
        mailbox.put("a", Received("a", large, 0))
    mailbox.put("b", Received("b", large, 0))
    mailbox.put(None, Received("truth", large, 0))
    kept = MOST_WAITING_BYTES // len(large) + 1
    assert mailbox.lost == {"a": 100 - kept}
    assert [mailbox.get(0.0).key for _ in range(kept + 2)] == [*"a" * kept, "b", "truth"]
    assert mailbox.empty()
    mailbox.put("a", Received("a", large, 0))  # there is room again
    assert mailbox.get(0.0).key == "a"
    assert mailbox.lost == {"a": 100 - kept}


def test_a_flood_of_empty_messages_is_bounded_too() -> None:
    mailbox = Mailbox()
    for _ in range(40_000):
        mailbox.put("a", Received("a", b"", 0))
    assert mailbox.lost["a"] > 20_000
