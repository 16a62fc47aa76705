"""What a run does while robots answer, are late, are lost, come back, or say what is not taken."""

from functools import partial

import msgpack
import pytest
import structlog
from structlog.testing import capture_logs
from world_helpers import EPOCH, SPRINT_STEPS, lanes, sprint
from world_stage import ScriptedBus, ScriptedInbox, Stage

from chassis.refusal import Refusal
from protocol.version import PROTOCOL_VERSION
from world.bus import COMMANDS_A_STEP
from world.clock import LockStep
from world.judge import MOST_TOLD, Versions
from world.run import Run
from world.world import World


def test_a_lock_step_run_publishes_every_step_once_and_the_verdict_last():
    stage = Stage()
    assert stage.drive() == stage.bus.truths[-1]
    assert [truth.step for truth in stage.bus.truths] == list(range(SPRINT_STEPS + 1))
    assert [truth.verdict for truth in stage.bus.truths] == [None] * SPRINT_STEPS + ["arrived"]
    assert [seen["1"].step for seen in stage.bus.observations] == list(range(SPRINT_STEPS))
    assert stage.misses() == {"1": 0, "2": 0}
    assert stage.now() == 0.0


def test_lock_step_is_released_by_the_first_right_answer_and_by_no_wrong_one():
    stage = Stage()

    def answer_wrongly_first():
        stage.bus.silent.clear()
        stage.inbox.script = [
            lambda: stage.bus.answer("2", 2),
            lambda: stage.bus.answer("2", 3, epoch=EPOCH + 1),
            lambda: stage.bus.answer("2", 3, robot="1"),
            lambda: stage.inbox.store_command("2", b"garbage"),
            lambda: stage.bus.answer("2", 3),
        ]

    stage.bus.at_step[0] = lambda: stage.bus.answer("1", 0, acceleration_mps2=-2.0)
    stage.bus.at_step[2] = lambda: stage.bus.silent.add("2")
    stage.bus.at_step[3] = answer_wrongly_first
    with capture_logs() as log:
        assert stage.drive().verdict == "arrived"
    assert stage.inbox.script == []
    assert stage.misses() == {"1": 0, "2": 0}
    assert stage.bus.truths[1].robots["1"].acceleration_mps2 == sprint(0), "the first answer counts"
    refused = [entry["reason"] for entry in log if entry["event"] == "command refused"]
    assert refused == [
        "answers a step again",
        "answers another step",
        "answers another epoch",
        "names another robot",
        "not a valid message",
    ]


def test_a_present_but_silent_robot_is_waited_for_up_to_the_limit():
    stage = Stage(time_limit_s=0.5)
    stage.bus.at_step[1] = lambda: stage.bus.silent.add("2")
    assert stage.drive().verdict == "timeout"
    assert stage.misses() == {"1": 0, "2": 3}
    assert stage.now() == pytest.approx(3 * 60.0)


def lose(stage, *names):
    for name in names:
        stage.inbox.store_presence(name, present=False)


def test_lock_step_stands_still_until_one_of_the_robots_that_were_all_lost_is_back():
    stage = Stage(time_limit_s=0.5)
    stage.bus.silent = {"1", "2"}
    seen = []

    def come_back():
        seen.append(stage.bus.truths[-1].step)
        stage.bus.silent.clear()
        stage.inbox.store_presence("1", present=True)

    stage.inbox.script = [lambda: lose(stage, "1", "2"), come_back]
    stage.drive()
    assert stage.misses() == {"1": 1, "2": 1}
    assert seen == [0], "no step is published to nobody"


def test_lock_step_does_not_wait_for_ever_for_robots_that_do_not_come_back(monkeypatch):
    monkeypatch.setattr("world.run.RETURN_S", 0.05)
    stage = Stage(time_limit_s=0.5)
    stage.bus.silent = {"1", "2"}
    stage.inbox.script = [lambda: lose(stage, "1", "2")]
    assert stage.drive().verdict == "timeout"


def test_lock_step_waits_for_its_reader_to_come_back():
    stage = Stage()
    stage.inbox.store_presence("reader", present=True)
    stage.run.wait_for_robots(0.0, ("reader",))
    seen = []

    def come_back():
        seen.append(stage.bus.truths[-1].step)
        stage.inbox.store_presence("reader", present=True)

    stage.inbox.script = [come_back]
    stage.bus.at_step[3] = lambda: lose(stage, "reader")
    assert stage.drive().verdict == "arrived"
    assert seen == [3], "no step goes unread"


def test_a_robot_whose_token_goes_is_no_longer_waited_for():
    stage = Stage()
    stage.bus.silent = {"2"}
    stage.inbox.script = [lambda: stage.inbox.store_presence("2", present=False)]
    with capture_logs() as log:
        assert stage.drive().verdict == "deadlock"
    assert stage.now() == 0.0
    assert stage.misses() == {"1": 0, "2": stage.world.step}
    assert [entry["robot"] for entry in log if entry["event"] == "robot lost"] == ["2"]


def test_a_robot_that_left_and_returned_is_waited_for_from_the_next_step_on():
    stage = Stage()

    def leave_and_return():
        stage.inbox.store_presence("2", present=False)
        stage.inbox.store_presence("2", present=True)
        stage.inbox.script = [lambda: stage.bus.answer("2", 1)]

    stage.bus.silent = {"2"}
    stage.inbox.script = [leave_and_return]
    stage.bus.at_step[1] = stage.bus.silent.clear
    with capture_logs() as log:
        stage.drive()
    assert stage.inbox.script == []
    assert stage.bus.truths[1].robots["2"].deadline_misses == 1
    assert stage.bus.truths[2].robots["2"].deadline_misses == 1
    told = [entry["event"] for entry in log if entry["event"] in ("robot lost", "robot returned")]
    assert told == ["robot lost", "robot returned"]


def test_a_robot_that_says_too_much_is_not_awaited_and_holds_up_nobody():
    stage = Stage(time_limit_s=0.5)

    def flood():
        for _ in range(COMMANDS_A_STEP):
            stage.inbox.store_command("2", b"\xc1")

    stage.bus.silent = {"2"}
    for step in range(5):
        stage.bus.at_step[step] = flood
    with capture_logs() as log:
        assert stage.drive().verdict == "timeout"
    refused = [(entry["robot"], entry["reason"]) for entry in log if entry["event"] == "command refused"]
    assert refused == [("2", "not a valid message")], "told once, counted always"
    assert stage.now() == 0.0
    assert stage.misses() == {"1": 0, "2": 5}
    assert stage.bus.truths[-1].refused == {"2": {"not a valid message": 5 * COMMANDS_A_STEP}}


@pytest.mark.parametrize("real_time", [False, True])
def test_an_interruption_while_waiting_repeats_the_step_with_the_verdict(real_time):
    stage = Stage(real_time=real_time)
    stage.bus.at_step[2] = lambda: stage.bus.silent.add("2")
    stage.bus.at_step[3] = lambda: stage.inbox.script.append(stage.inbox.interrupt)
    assert stage.drive().verdict == "interrupted"
    assert [truth.step for truth in stage.bus.truths] == [0, 1, 2, 3, 3]
    assert [truth.verdict for truth in stage.bus.truths] == [None] * 4 + ["interrupted"]


def test_real_time_counts_a_late_command_as_missed_and_refuses_it():
    stage = Stage(real_time=True, time_limit_s=0.6)
    stage.bus.at_step[2] = lambda: stage.bus.silent.add("2")

    def answer_the_step_before():
        stage.bus.silent.clear()
        stage.bus.answer("2", 3)

    stage.bus.at_step[4] = answer_the_step_before
    with capture_logs() as log:
        assert stage.drive().verdict == "timeout"
    assert stage.now() == pytest.approx(0.6)
    assert [truth.robots["2"].deadline_misses for truth in stage.bus.truths] == [0, 0, 0, 0, 1, 2, 2]
    assert stage.misses()["1"] == 0
    refused = [(entry["robot"], entry["reason"]) for entry in log if entry["event"] == "command refused"]
    assert refused == [("2", "answers another step")]


def comes(robot, *, present=True):
    return lambda inbox: inbox.store_presence(robot, present=present)


def asks(robot, version=PROTOCOL_VERSION):
    return lambda inbox: inbox.store_question(robot, msgpack.packb({"schema_version": version}))


def barrier(*script, timeout_s):
    """What is logged while this happens before three robots are there."""
    world = World(lanes(3), seed=0, epoch=EPOCH)
    inbox = ScriptedInbox(world.robots)
    inbox.script = [partial(happens, inbox) for happens in script]
    with capture_logs() as log:
        Run(world, LockStep(60.0), inbox, ScriptedBus(inbox), structlog.get_logger()).wait_for_robots(
            timeout_s
        )
    return log


def test_the_barrier_opens_when_all_robots_are_there_together():
    goes = comes("1", present=False)
    log = barrier(comes("1"), comes("3"), comes("3"), goes, comes("2"), comes("1"), timeout_s=200.0)
    waited_for = [entry["missing"] for entry in log if entry["event"] == "waiting for robots"]
    assert waited_for == ["1, 2, 3", "2, 3", "2", "1, 2", "1"]


NEWER = "robot 1 speaks version 9 of the protocol, the world version 1; update the software of the world"
OLDER = "robot 3 speaks version 0 of the protocol, the world version 1; update the software of robot 3"


def test_a_missing_robot_that_speaks_another_version_is_told_of_with_both_versions():
    with pytest.raises(Refusal) as missing:
        barrier(asks("1", 9), asks("3", 0), asks("2"), comes("2"), timeout_s=0.05)
    assert f"missing: 1, 3. Step 0 was not published. R{NEWER[1:]}. R{OLDER[1:]}. Start" in str(missing.value)
    with pytest.raises(Refusal, match=r"missing: 1, 3\. .* Robot 3 does not say which version") as missing:
        barrier(
            comes("2"), asks("1", 9), asks("1"), lambda inbox: inbox.store_question("3", b""), timeout_s=0.05
        )
    assert NEWER[1:] not in str(missing.value), "it has come back in the right version"


def test_questions_in_other_versions_are_logged_once_each_and_do_not_fill_the_log():
    versions = Versions(structlog.get_logger())
    asked = [("1", msgpack.packb({"schema_version": 9 + one})) for one in range(2 * MOST_TOLD)]
    with capture_logs() as log:
        versions.hear([asked[0], asked[0]])
        assert [entry["event"] for entry in log] == [NEWER]
        versions.hear(asked)
    assert len(log) == MOST_TOLD
