"""What a run does while robots answer, are late, are lost, come back, or say what is not taken."""

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
from world.judge import MISSES_EVERY_S, MOST_TOLD, Misses, Versions
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


def test_a_robot_that_is_back_before_a_step_is_published_is_waited_for(monkeypatch):
    stage = Stage()
    advance = stage.world.advance

    def leave_and_return(commands):
        if stage.world.step == 0:
            stage.inbox.store_presence("2", present=False)
            stage.inbox.store_presence("2", present=True)
            stage.bus.silent.add("2")
            stage.bus.at_step[1] = stage.bus.silent.clear
            stage.inbox.script = [lambda: stage.bus.answer("2", 1)]
        return advance(commands)

    monkeypatch.setattr(stage.world, "advance", leave_and_return)
    assert stage.drive().verdict == "arrived"
    assert stage.misses() == {"1": 0, "2": 0}


def test_refused_commands_are_logged_once_for_each_robot_and_reason_and_counted():
    stage = Stage()

    def nonsense():
        for robot in ("1", "2"):
            for _ in range(3):
                stage.inbox.store_command(robot, b"\xc1")

    for step in range(SPRINT_STEPS):
        stage.bus.at_step[step] = nonsense
    with capture_logs() as log:
        assert stage.drive().verdict == "arrived"
    assert stage.misses() == {"1": 0, "2": 0}
    refused = [(entry["robot"], entry["reason"]) for entry in log if entry["event"] == "command refused"]
    assert sorted(refused) == [
        ("1", "not a valid message"),
        ("2", "not a valid message"),
    ]
    (end,) = (entry for entry in log if entry["event"] == "run ended")
    counted = {robot: {"not a valid message": 3 * SPRINT_STEPS} for robot in ("1", "2")}
    assert end["refused_commands"] == stage.bus.truths[-1].refused == counted


def test_a_robot_that_says_too_much_is_not_awaited_and_holds_up_nobody():
    stage = Stage(time_limit_s=0.5)

    def flood():
        for _ in range(COMMANDS_A_STEP):
            stage.inbox.store_command("2", b"\xc1")

    stage.bus.silent = {"2"}
    for step in range(5):
        stage.bus.at_step[step] = flood
    assert stage.drive().verdict == "timeout"
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


def test_a_run_that_is_over_at_the_start_tells_its_verdict_once():
    stage = Stage(length_m=0.05)
    assert stage.drive().verdict == "arrived"
    assert [(truth.step, truth.verdict) for truth in stage.bus.truths] == [(0, "arrived")]


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


def barrier(*, script=(), present=(), timeout_s=0.0):
    world = World(lanes(3), seed=0, epoch=EPOCH)
    inbox = ScriptedInbox(world.robots)
    inbox.script = [step(inbox) for step in script]
    bus = ScriptedBus(inbox)
    for robot in present:
        inbox.store_presence(robot, present=True)
    run = Run(world, LockStep(60.0), inbox, bus, structlog.get_logger())
    with capture_logs() as log:
        run.wait_for_robots(timeout_s)
    return run, bus, [entry.get("missing") for entry in log if entry["event"] == "waiting for robots"]


def comes(robot):
    return lambda inbox: lambda: inbox.store_presence(robot, present=True)


def goes(robot):
    return lambda inbox: lambda: inbox.store_presence(robot, present=False)


def test_the_barrier_opens_when_all_robots_are_there_together():
    script = (comes("1"), comes("3"), comes("3"), goes("1"), comes("2"), comes("1"))
    _, bus, waited_for = barrier(script=script, timeout_s=200.0)
    assert waited_for == ["1, 2, 3", "2, 3", "2", "1, 2", "1"]
    assert bus.truths == []


def asks(robot, version=PROTOCOL_VERSION):
    question = msgpack.packb({"schema_version": version})
    return lambda inbox: lambda: inbox.store_question(robot, question)


def says_nothing(inbox):
    return lambda: inbox.store_question("3", b"")


NEWER = "robot 1 speaks version 9 of the protocol, the world version 1; update the software of the world"
OLDER = "robot 3 speaks version 0 of the protocol, the world version 1; update the software of robot 3"


def test_a_missing_robot_that_speaks_another_version_is_told_of_with_both_versions():
    script = (asks("1", 9), asks("3", 0), asks("2"), comes("2"))
    with pytest.raises(Refusal) as missing:
        barrier(script=script, timeout_s=0.05)
    assert f"missing: 1, 3. Step 0 was not published. R{NEWER[1:]}. R{OLDER[1:]}. Start" in str(missing.value)
    with pytest.raises(Refusal, match=r"missing: 1, 3\. .* Robot 3 does not say which version") as missing:
        barrier(script=(asks("1", 9), asks("1"), says_nothing), present=("2", "9"), timeout_s=0.05)
    assert NEWER[1:] not in str(missing.value), "it has come back in the right version"


def test_a_robot_that_speaks_another_version_is_logged_once_also_during_the_run():
    stage = Stage()
    for step in range(3):
        stage.bus.at_step[step] = asks("1", 9)(stage.inbox)
    with capture_logs() as log:
        assert stage.drive().verdict == "arrived"
    assert [entry["event"] for entry in log if entry.get("robot") == "1"] == [NEWER]


def test_questions_in_ever_other_versions_do_not_fill_the_log():
    versions = Versions(structlog.get_logger())
    with capture_logs() as log:
        versions.hear(("1", msgpack.packb({"schema_version": 2 + one})) for one in range(2 * MOST_TOLD))
    assert len(log) == MOST_TOLD


def test_missed_commands_are_told_at_once_and_then_summed_up():
    now_s = 50.0
    with capture_logs() as log:
        misses = Misses(structlog.get_logger(), lambda: now_s)
        misses.add([])
        misses.add(["1"])
        misses.add(["1", "2"])
        misses.add(["2"])
        now_s += MISSES_EVERY_S
        misses.add(["2"])
        misses.add(["1"])
        misses.tell()
        misses.tell()
    assert [entry["steps_by_robot"] for entry in log] == [{"1": 1}, {"1": 1, "2": 3}, {"1": 1}]
