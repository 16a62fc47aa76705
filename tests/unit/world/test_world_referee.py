import math

import pytest
from world_helpers import at, lanes

from world.referee import Referee


def watch_standing(referee, states, first, last):
    """Show the same states at the steps first…last; the verdicts step by step."""
    verdicts = {}
    for step in range(first, last + 1):
        referee.watch(step, states)
        verdicts[step] = referee.verdict
    return verdicts


def test_a_robot_arrives_at_the_first_step_within_tolerance_and_stays_arrived():
    referee = Referee(lanes(2))
    waiting = at(0.0, 2.0)
    for step, x in enumerate((0.0, 0.899, 0.901, 0.5, 1.0)):
        referee.watch(step, {"1": at(x, 0.0), "2": waiting})
    assert referee.arrived_s == {"1": pytest.approx(0.2), "2": None}
    assert referee.verdict is None


@pytest.mark.parametrize(
    ("state", "arrived"),
    [
        (at(1.0, 0.0), True),
        (at(1.0, 0.0, 0.0, 0.11), False),
        (at(1.0, 0.0, 0.11, 0.0), False),
        (at(1.0, 0.0, 2 * math.tau, 0.0), True),
        (at(1.06, 0.0, 0.0, 0.06), True),
        (at(1.08, 0.0, 0.0, 0.08), False),
    ],
)
def test_arrival_is_the_norm_of_the_whole_state_with_the_heading_wrapped(state, arrived):
    referee = Referee(lanes(1))
    referee.watch(0, {"1": state})
    assert (referee.arrived_s["1"] == 0.0) == arrived
    assert referee.verdict == ("arrived" if arrived else None)


def test_the_run_ends_when_the_last_robot_arrives():
    referee = Referee(lanes(2))
    referee.watch(0, {"1": at(1.0, 0.0), "2": at(0.0, 2.0)})
    assert referee.verdict is None
    referee.watch(1, {"1": at(1.0, 0.0), "2": at(1.0, 2.0)})
    assert referee.verdict == "arrived"
    assert referee.arrived_s == {"1": 0.0, "2": pytest.approx(0.1)}


def test_centres_closer_than_both_radii_have_collided_and_each_pair_is_listed_once():
    referee = Referee(lanes(3))
    for step, gap in enumerate((1.5, 0.991, 0.989, 1.2, 0.5)):
        states = {"1": at(0.0, 0.0), "2": at(gap, 0.0), "3": at(9.0, 0.0)}
        referee.watch(step, states)
        assert referee.distances.collisions == (() if gap > 0.99 and step < 2 else (("1", "2"),))
        assert referee.verdict is None
    referee.watch(5, {"1": at(0.0, 0.0), "2": at(3.0, 0.0), "3": at(3.5, 0.0)})
    assert referee.distances.collisions == (("1", "2"), ("2", "3"))


def test_the_collision_distance_follows_the_radii_of_the_two():
    small = lanes(2)
    robots = [small.robots[0].model_copy(update={"radius_m": 0.2}), small.robots[1]]
    referee = Referee(small.model_copy(update={"robots": robots}))
    referee.watch(0, {"1": at(0.0, 0.0), "2": at(0.7, 0.0)})
    assert referee.distances.collisions == ()
    referee.watch(1, {"1": at(0.0, 0.0), "2": at(0.69, 0.0)})
    assert referee.distances.collisions == (("1", "2"),)


def test_the_smallest_distance_of_any_two_centres_is_kept():
    referee = Referee(lanes(3))
    for step, x in enumerate((5.0, 3.0, 4.0)):
        referee.watch(step, {"1": at(0.0, 0.0), "2": at(x, 4.0), "3": at(-8.0, 0.0)})
    assert referee.distances.minimum_distance_m == pytest.approx(5.0)


def test_one_robot_alone_has_no_smallest_distance():
    referee = Referee(lanes(1))
    referee.watch(0, {"1": at(0.0, 0.0)})
    assert referee.distances.minimum_distance_m is None


def test_the_driven_way_is_the_length_of_the_path():
    referee = Referee(lanes(2))
    for step, (x, y) in enumerate(((0.0, 0.0), (0.3, 0.4), (0.0, 0.0), (0.0, 0.25))):
        referee.watch(step, {"1": at(x, y), "2": at(9.0, 9.0)})
    assert referee.distances.driven_m == {"1": pytest.approx(1.25), "2": 0.0}


def test_five_seconds_without_movement_are_a_deadlock_and_less_are_not():
    verdicts = watch_standing(Referee(lanes(2)), {"1": at(0.0, 0.0), "2": at(0.0, 2.0)}, 0, 50)
    assert [step for step, verdict in verdicts.items() if verdict] == [50]
    assert verdicts[50] == "deadlock"


def test_the_five_seconds_count_from_the_last_movement():
    referee = Referee(lanes(2))
    for step in range(30):
        referee.watch(step, {"1": at(0.02 * step, 0.0), "2": at(0.0, 2.0)})
    verdicts = watch_standing(referee, {"1": at(0.58, 0.0), "2": at(0.0, 2.0)}, 30, 77)
    # At step k the window reaches back to step k − 50, from where 0.58 m − 0.02 m·(k − 50) were driven:
    # less than 0.05 m for the first time at step 77.
    assert [step for step, verdict in verdicts.items() if verdict] == [77]


@pytest.mark.parametrize(("way_m", "deadlock"), [(0.049, True), (0.051, False)])
def test_one_robot_that_moves_is_enough_against_a_deadlock(way_m, deadlock):
    referee = Referee(lanes(2))
    for step in range(51):
        referee.watch(step, {"1": at(way_m * step / 50, 0.0), "2": at(0.0, 2.0)})
    assert referee.verdict == ("deadlock" if deadlock else None)


def test_a_robot_manoeuvring_on_the_spot_is_not_in_deadlock():
    referee = Referee(lanes(1))
    for step in range(101):
        referee.watch(step, {"1": at(0.02 * (step % 2), 0.0)})
    assert referee.verdict is None


def test_parked_robots_do_not_make_a_deadlock_of_one_still_driving():
    referee = Referee(lanes(2, length_m=9.0))
    for step in range(80):
        referee.watch(step, {"1": at(9.0, 0.0), "2": at(0.1 * step, 2.0)})
    assert referee.verdict is None


@pytest.mark.parametrize(("step_s", "limit_s", "last"), [(0.1, 1.0, 10), (0.1, 0.3, 3), (0.25, 0.6, 3)])
def test_the_run_ends_at_the_first_step_at_or_after_the_time_limit(step_s, limit_s, last):
    referee = Referee(lanes(1, length_m=9.0, step_s=step_s, time_limit_s=limit_s))
    verdicts = watch_standing(referee, {"1": at(0.0, 0.0)}, 0, last)
    assert [step for step, verdict in verdicts.items() if verdict] == [last]
    assert verdicts[last] == "timeout"


def test_arriving_at_the_time_limit_is_arriving():
    referee = Referee(lanes(1, time_limit_s=1.0))
    watch_standing(referee, {"1": at(0.0, 0.0)}, 0, 9)
    referee.watch(10, {"1": at(1.0, 0.0)})
    assert referee.verdict == "arrived"


TOUCHING = {"1": at(0.0, 0.0), "2": at(0.5, 0.0)}


@pytest.mark.parametrize(
    ("limit_s", "end", "last"),
    [
        (60.0, {"1": at(1.0, 0.0), "2": at(1.0, 2.0)}, 1),
        (60.0, {"1": at(0.0, 0.0), "2": at(0.0, 2.0)}, 51),
        (0.2, {"1": at(0.0, 0.0), "2": at(0.0, 2.0)}, 2),
    ],
    ids=["arrived", "deadlock", "timeout"],
)
def test_a_collision_makes_every_end_a_collision(limit_s, end, last):
    referee = Referee(lanes(2, time_limit_s=limit_s))
    referee.watch(0, TOUCHING)
    verdicts = watch_standing(referee, end, 1, last)
    assert [step for step, verdict in verdicts.items() if verdict] == [last]
    assert verdicts[last] == "collision"


def test_an_interruption_stands_above_a_collision():
    referee = Referee(lanes(2))
    referee.watch(0, TOUCHING)
    referee.interrupt()
    assert referee.verdict == "interrupted"


def test_an_interruption_after_the_end_changes_nothing():
    referee = Referee(lanes(1))
    referee.watch(0, {"1": at(1.0, 0.0)})
    referee.interrupt()
    assert referee.verdict == "arrived"
