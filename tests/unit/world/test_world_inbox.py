import threading

import pytest

from world.bus import COMMANDS_A_STEP, Inbox


def wait_for_commands(inbox, count):
    commands = []
    while len(commands) < count:
        commands += inbox.take(250.0).commands
    return commands


def test_a_flooding_robot_waits_for_the_next_step_and_nothing_it_said_is_lost():
    """Until the end, which releases whoever waits."""
    inbox = Inbox(["1", "2"])
    count = 4 * COMMANDS_A_STEP
    thread = threading.Thread(target=lambda: [inbox.store_command("2", b"") for _ in range(count)])
    thread.start()
    assert len(wait_for_commands(inbox, COMMANDS_A_STEP)) == COMMANDS_A_STEP
    assert inbox.take(0.05).commands == ()
    assert inbox.take(0.0).exhausted == {"2"}
    inbox.store_command("1", b"mine")  # another robot's callback is not held up
    assert inbox.take(250.0).commands == (("1", b"mine"),)
    inbox.begin_step()
    assert len(wait_for_commands(inbox, COMMANDS_A_STEP)) == COMMANDS_A_STEP
    inbox.close()
    thread.join()
    assert inbox.take(0.0).commands == ()


def test_presence_lasts_and_a_departure_is_told_once_even_if_the_robot_is_back():
    inbox = Inbox(["1", "2"])
    for robot in ("1", "2"):
        inbox.store_presence(robot, present=True)
    for back in (True, False):
        inbox.store_presence("2", present=False)
        if back:
            inbox.store_presence("2", present=True)
        arrivals = inbox.take(0.0)
        assert (arrivals.present, arrivals.gone) == ({"1", "2"} if back else {"1"}, {"2"})
        assert inbox.take(0.0).gone == frozenset()


@pytest.mark.parametrize(
    "happen",
    [
        lambda inbox: inbox.store_command("1", b""),
        lambda inbox: inbox.store_presence("1", present=True),
        lambda inbox: inbox.store_presence("1", present=False),
        Inbox.interrupt,
    ],
)
def test_a_waiting_inbox_wakes_on_news(happen):
    inbox = Inbox(["1"])
    empty = inbox.take(0.0)
    teller = threading.Thread(target=happen, args=(inbox,))
    teller.start()
    arrivals = inbox.take(250.0)  # without a wake-up the test's own timeout is near
    teller.join()
    assert arrivals != empty


def test_what_has_come_is_taken_once_and_an_interrupted_inbox_never_waits_again():
    inbox = Inbox(["1", "2"])
    for robot, payload in (("2", b"a"), ("1", b"b"), ("2", b"c")):
        inbox.store_command(robot, payload)
        inbox.store_question(robot, payload)
    taken = inbox.take(0.0)
    assert [payload for robot, payload in taken.commands if robot == "2"] == [b"a", b"c"]
    assert dict(taken.questions) == {"1": b"b", "2": b"c"}
    inbox.interrupt()
    nothing = ((), frozenset(), frozenset(), frozenset(), (), True)
    assert [inbox.take(250.0) for _ in range(3)] == [nothing] * 3
