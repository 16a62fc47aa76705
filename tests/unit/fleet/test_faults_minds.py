"""How robots behave while a fault lies on their minds, and that they go on as before after it."""

import math
from typing import Any

import pytest
from faults_helpers import MEETING, drive, fault, place, truths

from fleet.run.virtual import Step

SOON_S = 0.5
SOON = 5
ALONE: dict[str, Any] = {"robots": [MEETING[0]]}
"""Robot 1, which needs to mind nobody."""


def first(kind: str, **fields: Any) -> dict[str, Any]:
    """A fault of robot 1."""
    return fault(kind, robots=[1], **({"start_s": SOON_S} | fields))


def standing(driven: list[Step], robot: str = "1") -> bool:
    return abs(driven[-1].truth.robots[robot].state.speed_mps) < 1e-3


def distance_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    return math.dist(one, other)


def minds(driven: list[Step]) -> list[Any]:
    return [step.decisions["1"].mind for step in driven[:-1]]


def test_a_robot_stops_and_stays() -> None:
    driven = drive(first("stops"), time_limit_s=4.0)
    there = [place(truth, "1") for truth in truths(driven)]
    assert standing(driven)
    assert distance_m(there[-1], (4.0, 0.0)) > 1.0
    assert distance_m(there[-1], there[-10]) < 1e-3
    assert driven[-1].truth.robots["1"].clipped_commands == 0, "it brakes as its limits allow"
    assert driven[-1].truth.robots["1"].deadline_misses == 0, "and says so"
    assert {seen.step for seen in minds(driven)} == set(range(len(driven) - 1)), "and goes on thinking"


@pytest.mark.parametrize("kind", ["stops", "turns-back"])
def test_a_robot_that_did_so_for_a_while_arrives(kind: str) -> None:
    driven = drive(first(kind, duration_s=1.0))
    speeds = [truth.robots["1"].state.speed_mps for truth in truths(driven)]
    assert min(map(abs, speeds[SOON:])) < 0.2 < 0.5 * max(speeds)
    assert driven[-1].truth.verdict == "arrived"


@pytest.mark.parametrize("goals", ["joint-fit", "exchanged"])
def test_a_robot_that_ignores_others_drives_as_if_alone(goals: Any) -> None:
    ignoring = first("ignores", start_s=0.0)
    alone, driven, minded = (
        [place(truth, "1") for truth in truths(drive(*faults, goals=goals, time_limit_s=2.5, **robots))]
        for faults, robots in (((), ALONE), ((ignoring,), {}), ((), {}))
    )
    assert driven == alone != minded


def test_a_robot_that_ignored_others_for_a_while_knows_them_at_once_after_it() -> None:
    driven = drive(first("ignores", duration_s=0.3))
    seen = [set(mind.prediction) for mind in minds(driven)]
    assert seen[: SOON + 4] == [{"1", "2"}] * SOON + [{"1"}] * 3 + [{"1", "2"}]
    assert driven[-1].truth.robots["1"].clipped_commands == 0, "it knew what it was driving"


@pytest.mark.parametrize("goals", ["joint-fit", "exchanged"])
def test_a_robot_turns_back_to_where_it_was_first_seen(goals: Any) -> None:
    driven = drive(first("turns-back"), goals=goals)
    assert distance_m(place(driven[-1].truth, "1"), (-4.0, 0.0)) < 0.2
    assert standing(driven)
    assert driven[-1].truth.robots["2"].arrived_s is not None


@pytest.mark.parametrize("goals", ["joint-fit", "exchanged"])
def test_a_robot_chases_another_one_wherever_that_is(goals: Any) -> None:
    driven = drive(first("chases", seen=2, start_s=0.0), goals=goals, time_limit_s=1.5)
    for mind, truth in zip(minds(driven), truths(driven), strict=False):
        chased = place(truth, "2")
        assert distance_m(mind.plan[-1], chased) < distance_m(mind.plan[0], chased)
        assert set(mind.prediction) == {"1"}


def test_another_cost_makes_another_way_and_others_are_still_minded() -> None:
    """With the plans of eq. 1; the default method has a cost of its own in them."""
    plain = drive(time_limit_s=2.5, goals="ioc")
    hasty = drive(
        first("other-cost", start_s=0.0, weights={"x": 50.0, "y": 50.0, "heading": 0.0, "speed": 0.0}),
        time_limit_s=2.5,
        goals="ioc",
    )
    top_mps = [max(truth.robots["1"].state.speed_mps for truth in truths(run)) for run in (plain, hasty)]
    assert top_mps[1] > 1.05 * top_mps[0]
    assert all(set(mind.prediction) == {"1", "2"} for mind in minds(hasty)[:SOON])


def test_the_first_of_several_behaviours_counts() -> None:
    both = drive(first("stops"), first("turns-back"), time_limit_s=1.5)
    assert truths(both) == truths(drive(first("stops"), time_limit_s=1.5))


def test_without_time_decisions_are_cut_short_at_once_where_they_would_go_on() -> None:
    driven = drive(first("no-time", duration_s=0.5))
    cut = [mind.cut_short_at for mind in minds(driven)]
    assert cut[:SOON] == [None] * SOON
    assert 0 in cut[SOON : SOON + 5]
    assert set(cut[SOON:]) <= {None, 0}  # None: one iteration was enough
    assert cut[SOON + 5 :] == [None] * (len(cut) - SOON - 5)
    assert driven[-1].truth.verdict == "arrived"


def test_what_the_solver_fails_at_is_not_driven_and_counted_on_when_the_behaviour_changes() -> None:
    driven = drive(
        first("solver-failure", duration_s=0.3),
        first("ignores", start_s=1.0, duration_s=0.2),
        time_limit_s=2.0,
    )
    failed = [bool(mind.failed) for mind in minds(driven)]
    assert failed[: SOON + 4] == [False] * SOON + [True] * 3 + [False]
    assert [mind.solver_failures for mind in minds(driven)[SOON + 3 :]] == [3] * (len(driven) - SOON - 4)
    assert [mind.decision for mind in minds(driven)] == list(range(len(driven) - 1))
    assert driven[-1].truth.robots["2"].deadline_misses == 0


def test_no_distance_can_be_kept_to_an_obstacle_on_top_of_the_robot() -> None:
    fleeing, healthy = (
        minds(drive(*faults, **ALONE, time_limit_s=0.2))[0].plan
        for faults in ([first("infeasible", start_s=0.0)], [])
    )
    assert max(distance_m(point, (-4.0, 0.0)) for point in fleeing) > 1.0, "it flees"
    assert fleeing != healthy
