"""Commands of the past, the future and other worlds move nobody; a world that does not judge obeys them."""

from collections.abc import Callable

import pytest
import zenoh
from silence_stage import EPOCH, KEYS, Evidence, Stage

from protocol.codec import encode
from protocol.messages import Command
from world.world import World

BRAKE_MPS2 = -1.0


def brake(robot: str, step: int, epoch: int = EPOCH) -> Command:
    """What nobody else says."""
    return Command(
        epoch=epoch,
        robot=robot,
        step=step,
        turn_rate_radps=0.3,
        acceleration_mps2=BRAKE_MPS2,
    )


Game = Callable[[int], Command]

GAMES: dict[str, tuple[Game, str]] = {
    "of the past": (lambda step: brake("1", max(step - 3, 0)), "answers another step"),
    "of the future": (lambda step: brake("1", step + 1000), "answers another step"),
    "of the far future": (lambda _: brake("1", 2**53), "answers another step"),
    "of another world": (lambda step: brake("1", step, EPOCH + 1), "answers another epoch"),
    "of another robot": (lambda step: brake("2", step), "names another robot"),
}


def play(stage: Stage, game: Game, evidence: Evidence) -> None:
    """Robot 1 says this before its honest answer to every pose, for twenty steps."""
    session = stage.connect("1")

    def say(sample: zenoh.Sample) -> None:
        session.put(KEYS.command("1"), encode(game(stage.world.step)))

    subscriber = session.declare_subscriber(KEYS.pose("1"), say)
    stage.passes(20)
    subscriber.undeclare()
    stage.passes(2)  # nobody uses the session any more when it is closed
    for truth in stage.truths:
        if truth.robots["1"].turn_rate_radps != 0.0:
            evidence.add(truth)


@pytest.mark.parametrize("name", GAMES)
def test_a_command_that_does_not_answer_the_step_is_refused_and_counted(name: str) -> None:
    game, reason = GAMES[name]
    evidence = Evidence()
    with Stage(policy=True) as stage:
        play(stage, game, evidence)
        stage.passes(5)
        refused = stage.truths[-1].refused
        assert evidence.found == []
        assert refused.keys() == {"1"}
        assert refused["1"][reason] >= 10
        stage.was_undisturbed(but_refused=frozenset({"1"}))


@pytest.mark.parametrize("name", GAMES)
def test_a_world_that_takes_any_step_would_obey_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(World, "refusal", lambda *_: None)
    evidence = Evidence()
    with Stage(policy=True) as stage:
        play(stage, GAMES[name][0], evidence)
        assert evidence.comes()


def test_with_the_others_password_one_is_the_other() -> None:
    """The limit of what passwords can do, as docs/silence.md says: who has it is that robot."""
    with Stage(policy=True) as stage:
        session = stage.connect("2", stage.passwords["2"])
        session.put(KEYS.command("2"), b"\xc1")
        while "2" not in stage.truths[-1].refused:
            stage.passes(1)
