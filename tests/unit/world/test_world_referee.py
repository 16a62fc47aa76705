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
    for step, x in enumerate((0.0, 0.899, 0.901, 0.5, 1.0)):
        referee.watch(step, {"1": at(x, 0.0), "2": at(1.0, 2.0, 0.11)})
    assert referee.arrived_s == {"1": pytest.approx(0.2), "2": None}
    assert referee.verdict is None
    referee.watch(5, {"1": at(0.5, 0.0), "2": at(1.0, 2.0, 4 * math.pi)})
    assert referee.arrived_s == {"1": pytest.approx(0.2), "2": pytest.approx(0.5)}
    assert referee.verdict == "arrived"


def test_centres_closer_than_both_radii_have_collided_and_each_pair_is_listed_once():
    scenario = lanes(3)
    third = scenario.robots[2].model_copy(update={"radius_m": 0.2})
    referee = Referee(scenario.model_copy(update={"robots": [*scenario.robots[:2], third]}))
    for step, gap in enumerate((1.5, 0.991, 0.989, 1.2, 0.5)):
        referee.watch(step, {"1": at(0.0, 0.0), "2": at(gap, 0.0), "3": at(gap + 0.7, 0.0)})
        assert referee.distances.collisions == ((("1", "2"),) if step >= 2 else ())
        assert referee.verdict is None
    referee.watch(5, {"1": at(0.0, 0.0), "2": at(3.0, 0.0), "3": at(3.69, 0.0)})
    assert referee.distances.collisions == (("1", "2"), ("2", "3"))
    assert referee.distances.minimum_distance_m == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("way", "end"),
    [
        (lambda _: 0.0, 50),
        (lambda step: 0.049 * step / 50, 50),
        (lambda step: 0.051 * step / 50, None),
        (lambda step: 0.02 * (step % 2), None),
        # At step k the window reaches back to step k − 50, from where 0.58 m − 0.02 m·(k − 50) were driven:
        # less than 0.05 m for the first time at step 77.
        (lambda step: 0.02 * min(step, 29), 77),
    ],
    ids=["stands", "creeps", "drives slowly", "manoeuvres on the spot", "stops"],
)
def test_five_seconds_in_which_nobody_moves_are_a_deadlock_even_if_one_has_arrived(way, end):
    referee = Referee(lanes(2))
    for step in range((end or 80) + 1):
        assert referee.verdict is None
        referee.watch(step, {"1": at(way(step), 0.0), "2": at(1.0, 2.0)})
    assert referee.verdict == ("deadlock" if end else None)
    driven_m = sum(abs(way(each) - way(each - 1)) for each in range(1, step + 1))
    assert referee.distances.driven_m == {"1": pytest.approx(driven_m), "2": 0.0}


@pytest.mark.parametrize(("step_s", "limit_s", "last"), [(0.1, 0.3, 3), (0.25, 0.6, 3)])
def test_the_run_ends_at_the_first_step_at_or_after_the_time_limit(step_s, limit_s, last):
    referee = Referee(lanes(1, length_m=9.0, step_s=step_s, time_limit_s=limit_s))
    verdicts = watch_standing(referee, {"1": at(0.0, 0.0)}, 0, last)
    assert {step: verdict for step, verdict in verdicts.items() if verdict} == {last: "timeout"}
    arriving = Referee(lanes(1, step_s=step_s, time_limit_s=limit_s))
    watch_standing(arriving, {"1": at(0.0, 0.0)}, 0, last - 1)
    arriving.watch(last, {"1": at(1.0, 0.0)})
    assert arriving.verdict == "arrived"


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
    referee.watch(0, {"1": at(0.0, 0.0), "2": at(0.5, 0.0)})
    verdicts = watch_standing(referee, end, 1, last)
    assert [step for step, verdict in verdicts.items() if verdict] == [last]
    assert verdicts[last] == "collision"
