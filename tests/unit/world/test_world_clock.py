import pytest

from world.clock import LockStep, RealTime


class Time:
    """A clock that the test sets."""

    def __init__(self):
        self.now_s = 1000.0

    def __call__(self):
        return self.now_s


def test_lock_step_gives_every_step_the_whole_answer_time():
    time = Time()
    clock = LockStep(30.0, time)
    assert clock.waits_for_all
    for _ in range(3):
        clock.begin_step()
        assert clock.remaining_s() == 30.0
        time.now_s += 12.5
        assert clock.remaining_s() == 17.5
    time.now_s += 17.5
    assert clock.remaining_s() == 0.0
    assert clock.overruns == 0


@pytest.mark.parametrize(
    ("begun_s", "due_s", "overruns"),
    [
        ([0.0, 0.109, 0.209, 0.305, 0.4], [0.1, 0.2, 0.3, 0.4, 0.5], 0),
        ([0.0, 0.1, 0.75, 0.85, 0.95], [0.1, 0.2, 0.85, 0.95, 1.05], 1),
    ],
)
def test_small_delays_do_not_add_up_and_an_overrun_moves_the_schedule(begun_s, due_s, overruns):
    time = Time()
    clock = RealTime(0.1, time)
    assert not clock.waits_for_all
    for after_s, expected_s in zip(begun_s, due_s, strict=True):
        time.now_s = 1000.0 + after_s
        clock.begin_step()
        assert after_s + clock.remaining_s() == pytest.approx(expected_s)
    assert clock.overruns == overruns
