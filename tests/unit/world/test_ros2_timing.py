"""Stamps of a clock that is any time off, told on our own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from world.ros2.odometry import WINDOW_S, Stamps

SILENCE_S = 0.3


def measured(stamps, stamp_s, arrived_s):
    return stamps.measured_s(round(stamp_s * 1e9), arrived_s, SILENCE_S)


@given(off_s=st.floats(-1e9, 1e9), delays_s=st.lists(st.floats(0.0, 0.2), min_size=1, max_size=50))
def test_what_took_longer_than_the_quickest_is_older_by_so_much(off_s, delays_s):
    stamps, least_s = Stamps(), 1.0
    for index, delay_s in enumerate(delays_s):
        made_s, least_s = 100.0 + 0.5 * index, min(least_s, delay_s)
        if 0.5 * index > WINDOW_S:
            break
        found = measured(stamps, made_s + off_s, made_s + delay_s)
        assert found == pytest.approx(made_s + least_s, abs=1e-6)


def test_repeated_and_older_stamps_are_not_taken():
    stamps = Stamps()
    assert measured(stamps, 5.0, 1.0) == pytest.approx(1.0)
    assert measured(stamps, 5.0, 1.1) is None
    assert measured(stamps, 4.9, 1.2) is None
    assert measured(stamps, 5.1, 1.25) == pytest.approx(1.1)


def test_a_clock_that_was_set_back_is_believed_after_a_silence():
    stamps = Stamps()
    measured(stamps, 1000.0, 1.0)
    assert measured(stamps, 10.0, 1.2) is None
    assert measured(stamps, 10.2, 1.4) == pytest.approx(1.4)
    assert measured(stamps, 10.3, 1.5) == pytest.approx(1.5)


def test_a_clock_that_was_set_forward_is_believed_at_once():
    stamps = Stamps()
    measured(stamps, 10.0, 1.0)
    assert measured(stamps, 1000.0, 1.1) == pytest.approx(1.1)


def test_what_waited_for_a_link_to_come_back_is_as_old_as_it_is():
    stamps = Stamps()
    for index in range(10):
        measured(stamps, 500.0 + 0.1 * index, 0.1 * index)
    back_s = 4.0  # the link was away since 0.9 s
    for index in range(10, 40):
        assert measured(stamps, 500.0 + 0.1 * index, back_s) == pytest.approx(0.1 * index)


def test_drifting_clocks_are_followed():
    stamps = Stamps()
    for index in range(1000):
        arrived_s = 0.1 * index
        found = measured(stamps, arrived_s * 0.9999, arrived_s)  # 0.1 ms a second too slow
        assert arrived_s - found <= WINDOW_S * 1.1e-4
