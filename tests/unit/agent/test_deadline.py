"""What a decision takes from the clock is one number, with which it can be repeated."""

from collections.abc import Iterator

from hypothesis import given, settings
from hypothesis import strategies as st

from agent.solve import Deadline
from fleet.audit.replay import RepeatedDeadline

PAUSES = st.lists(st.lists(st.floats(0.0, 2.0), max_size=8), max_size=5)
"""By decision, the seconds before each question."""


def asked(deadline: Deadline, questions: int) -> list[bool]:
    deadline.begin()
    return [deadline.has_passed() for _ in range(questions)]


@settings(max_examples=50)
@given(PAUSES)
def test_a_repeated_deadline_answers_every_question_as_the_clock_did(decisions: list[list[float]]) -> None:
    readings: Iterator[float] = iter(())
    now_s = 0.0

    def clock() -> float:
        nonlocal now_s
        now_s += next(readings)
        return now_s

    deadline, repeated = Deadline(clock, 3.0), RepeatedDeadline()
    for pauses in decisions:
        readings = iter([0.0, *pauses])
        answers = asked(deadline, len(pauses))
        repeated.repeated = deadline.cut_short_at
        assert asked(repeated, len(pauses)) == answers
        assert repeated.cut_short_at == deadline.cut_short_at


def test_each_decision_is_cut_short_at_the_first_question_after_its_end() -> None:
    readings = iter([0.0, 1.0, 2.0, 10.0, 11.0])
    deadline = Deadline(lambda: next(readings), 1.5)
    assert asked(deadline, 4) == [False, True, True, True], "once over, the clock is not read again"
    assert deadline.cut_short_at == 1
    assert asked(deadline, 1) == [False]
    assert deadline.cut_short_at is None


def test_without_a_budget_no_clock_is_read() -> None:
    deadline = Deadline(lambda: next(iter([])), None)
    assert asked(deadline, 3) == [False] * 3
    assert deadline.cut_short_at is None
