"""The bench's side of a run: what it takes of what comes, what it still waits for, and how it ends."""

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from run_helpers import EPOCH, KEYS, command, mind, truth
from structlog.testing import capture_logs

from chassis.refusal import Refusal
from fleet.inject.process_faults import WORLD
from fleet.record.recording import BusMessage, RefusedMind
from fleet.run.listening import MOST_WAITING_BYTES, Decoder, Mailbox, Outstanding, Received, Subscriber
from protocol.codec import MessageError, encode
from protocol.messages import Message, Truth


def received(key: str, message: Message | bytes) -> Received:
    return Received(key, message if isinstance(message, bytes) else encode(message), 1)


def sample(key: str, payload: bytes) -> Any:
    return SimpleNamespace(key_expr=key, payload=SimpleNamespace(to_bytes=lambda: payload))


@pytest.fixture
def decoder() -> Decoder:
    """At step 5."""
    decoder = Decoder(KEYS)
    decoder.take(received(KEYS.truth, truth(5, {"a": {}, "b": {}})))
    return decoder


def test_one_mind_a_step_is_kept_and_what_else_comes_is_counted(decoder: Decoder) -> None:
    good = mind("a", 5)
    for key, message, expected in (
        ("a", good, None),
        ("a", good, "answers a step again"),
        ("a", mind("a", 4), "answers a step again"),
        ("a", mind("a", 7), "answers another step"),
        ("a", mind("b", 6), "names another robot"),
        ("a", mind("a", 6, epoch=EPOCH + 1), "answers another epoch"),
        ("a", b"\xc1", "not a valid message"),
        ("a", bytes(300_000), "not a valid message"),
        ("b", mind("b", 5), None),  # robots are judged by themselves
        ("a", mind("a", 6), None),  # a quick one: its truth comes after its poses
    ):
        taken = decoder.take(received(KEYS.mind(key), message))
        kept = BusMessage(KEYS.mind(key), message, 1)
        assert taken == (RefusedMind("a", expected) if expected else kept)  # type: ignore[arg-type]


def test_commands_are_kept_by_the_same_rule_and_counted_by_the_world(decoder: Decoder) -> None:
    good = command("a", 5)
    assert decoder.take(received(KEYS.command("a"), good)) == BusMessage(KEYS.command("a"), good, 1)
    for message in (good, command("b", 6), command("a", 6, EPOCH + 1), command("a", 99), b""):
        assert decoder.take(received(KEYS.command("a"), message)) is None


def test_in_a_new_world_steps_begin_anew(decoder: Decoder) -> None:
    decoder.take(received(KEYS.mind("a"), mind("a", 5)))
    new = {"epoch": EPOCH + 1}
    decoder.take(received(KEYS.truth, truth(0, {"a": {}}).model_copy(update=new)))
    first, far = (mind("a", step).model_copy(update=new) for step in (0, 5))
    assert decoder.take(received(KEYS.mind("a"), first)) == BusMessage(KEYS.mind("a"), first, 1)
    assert decoder.take(received(KEYS.mind("a"), far)) == RefusedMind("a", "answers another step")
    assert decoder.take(received(KEYS.truth, truth(6, {"a": {}}))) is None, "that world is gone"


def test_what_the_world_says_wrongly_is_an_error(decoder: Decoder) -> None:
    with pytest.raises(MessageError):
        decoder.take(received(KEYS.truth, b"\xc1"))


def test_a_robots_flood_is_bounded_counted_and_pushes_out_nothing_of_others() -> None:
    mailbox, large = Mailbox(KEYS), bytes(200_000)
    a, b = KEYS.mind("a"), KEYS.command("b")
    for _ in range(100):
        mailbox.put(sample(a, large))
    mailbox.put(sample(b, large))
    mailbox.put(sample(KEYS.truth, large))
    kept = MOST_WAITING_BYTES // len(large) + 1
    assert mailbox.lost == {"a": 100 - kept}
    assert [mailbox.get(0.0).key for _ in range(kept + 2)] == [*[a] * kept, b, KEYS.truth]
    mailbox.put(sample(a, large))  # there is room again
    assert mailbox.get(0.0).key == a
    assert mailbox.lost == {"a": 100 - kept}


def test_a_flood_of_empty_messages_is_bounded_too() -> None:
    mailbox = Mailbox(KEYS)
    for _ in range(20_000):
        mailbox.put(sample(KEYS.mind("a"), b""))
    assert mailbox.lost["a"] > 2_000


@pytest.mark.parametrize(
    ("commands", "step", "missed", "changes", "awaited"),
    [
        ([("1", 4), ("2", 4)], 5, {}, {"verdict": "arrived"}, False),
        ([("2", 4)], 5, {}, {"verdict": "arrived"}, True),  # the truth has overtaken a command
        ([("2", 4)], 5, {"deadline_misses": 1}, {"verdict": "arrived"}, False),  # whoever missed the step
        ([], 4, {}, {"verdict": "interrupted"}, False),  # an interrupted step leads nowhere
        ([], 0, {}, {"epoch": EPOCH + 1}, False),  # a new world
        ([("1", 4)], 5, {}, {"epoch": EPOCH + 1}, False),
    ],
)
def test_commands_that_led_to_the_newest_truth_are_awaited(
    commands: list[tuple[str, int]],
    step: int,
    missed: dict[str, int],
    changes: dict[str, Any],
    awaited: bool,
) -> None:
    outstanding = Outstanding()
    assert not outstanding.on_their_way()
    outstanding.add(truth(3, {"1": {}, "2": {}}))
    for each in (command("1", 3), command("2", 3), truth(4, {"1": {}, "2": {}})):
        outstanding.add(each)
    assert not outstanding.on_their_way()
    for robot, answered in commands:
        outstanding.add(command(robot, answered))
    outstanding.add(truth(step, {"1": missed, "2": {}}).model_copy(update=changes))
    assert outstanding.on_their_way() is awaited
    if awaited:
        outstanding.add(command("1", step - 1, EPOCH + 1))
        assert outstanding.on_their_way(), "this answers another world"
        outstanding.add(command("1", step - 1))
        assert not outstanding.on_their_way()


@pytest.fixture
def lost() -> dict[str, str]:
    """Processes that have ended for good."""
    return {}


@pytest.fixture
def bench(lost: dict[str, str]) -> Subscriber:
    """It has the scene; of its processes there is nothing to say."""
    processes = SimpleNamespace(take_started_again=list, is_running=lambda name: name not in lost)
    supervisor = SimpleNamespace(look=lambda: None, lost=lost)
    faults = SimpleNamespace(look=lambda: None, at=lambda truth: None)
    interruption = SimpleNamespace(insisted=False, requested=False)
    bench: Any = Subscriber("test", processes, supervisor, faults, interruption)  # type: ignore[arg-type]
    bench._scene_due = False
    return bench


def say(bench: Any, told: Truth) -> None:
    """As the world says it."""
    bench._mailbox.put(sample(KEYS.truth, encode(told)))


def steps(messages: Iterator[Any]) -> list[int]:
    return [item.message.step for item in messages if isinstance(item, BusMessage)]


def test_steps_that_the_bus_has_lost_are_logged(bench: Subscriber) -> None:
    for step in (0, 1, 4):
        say(bench, truth(step, {"1": {}}))
    say(bench, truth(5, {"1": {}}, verdict="timeout"))
    with capture_logs() as logged:
        assert steps(bench.listen()) == [0, 1, 4, 5]
    gaps = [(line["first"], line["last"]) for line in logged if line["event"] == "the recording lacks steps"]
    assert gaps == [(2, 3)]


def test_what_the_world_said_before_its_end_counts_however_late_it_comes(
    bench: Subscriber, lost: dict[str, str]
) -> None:
    lost[WORLD] = "world ended"
    late = threading.Timer(0.4, say, (bench, truth(0, {"1": {}}, verdict="timeout")))
    late.start()
    assert steps(bench.listen()) == [0]
    late.join()


def test_a_world_that_has_gone_without_a_verdict_is_a_failure(
    bench: Subscriber, lost: dict[str, str]
) -> None:
    say(bench, truth(0, {"1": {}}))
    lost[WORLD] = "world ended with exit status 3"
    messages = bench.listen()
    assert next(messages).message.step == 0  # type: ignore[union-attr]
    with pytest.raises(Refusal, match="exit status 3"):
        next(messages)
