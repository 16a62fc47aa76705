"""When faults strike whom: by the seed, their place in the list, the robot and the step."""

import pytest
from faults_helpers import fault, parsed

from fleet.inject.fault import Fault, Scheduled, schedule
from fleet.inject.scenario import effective, load_scenario
from scenarios import find

STEPS = 1000


def scheduled(*faults: dict[str, object], seed: int = 0, step_s: float = 0.1) -> list[Scheduled[Fault]]:
    return schedule(parsed(*faults), seed=seed, step_s=step_s)


def struck(each: Scheduled[Fault], robot: str = "1") -> list[int]:
    return [step for step in range(STEPS) if each.strike(robot, step)]


@pytest.mark.parametrize(
    ("start_s", "duration_s", "begin", "end"),
    [
        (0.0, None, 0, None),
        (0.3, 0.3, 3, 6),
        (0.31, 0.3, 4, 7),
        (2.0, 1e-3, 20, 21),
        (0.7, 0.7, 7, 14),
    ],
)
def test_times_become_the_first_step_at_or_after_them(
    start_s: float, duration_s: float | None, begin: int, end: int | None
) -> None:
    [each] = scheduled(fault("loss", rate=1.0, start_s=start_s, duration_s=duration_s))
    assert (each.begin, each.end) == (begin, end)
    assert struck(each)[0] == begin
    assert struck(each)[-1] == (STEPS if end is None else end) - 1


def test_a_time_is_drawn_from_its_interval_by_the_seed() -> None:
    wanted = fault("pause", start_s=[1.0, 9.0])
    begins = [[each.begin for each in scheduled(wanted, wanted, seed=seed)] for seed in range(40)]
    assert all(10 <= begin <= 90 for pair in begins for begin in pair)
    assert len({begin for begin, _ in begins}) > 20
    assert sum(one == other for one, other in begins) < 10, "each fault of a list has a time of its own"
    assert begins == [[each.begin for each in scheduled(wanted, wanted, seed=seed)] for seed in range(40)]


def test_a_rate_is_the_share_of_the_steps_that_are_struck() -> None:
    [each] = scheduled(fault("loss", rate=0.25))
    assert len(struck(each)) / STEPS == pytest.approx(0.25, abs=0.05)
    both = set(struck(each)) & set(struck(each, "2"))
    assert len(both) / STEPS == pytest.approx(0.0625, abs=0.04), "robots are struck independently"


def test_a_fault_befalls_the_robots_that_it_names_or_all() -> None:
    named, every = scheduled(fault("loss", rate=1.0, robots=[2]), fault("loss", rate=1.0))
    assert [bool(struck(each, robot)) for each in (named, every) for robot in "12"] == [
        False,
        True,
        True,
        True,
    ]


def test_robots_that_are_late_or_leave_are_absent_meanwhile() -> None:
    faults = parsed(
        fault("arrives-late", robots=[1], start_s=1.0),
        fault("leaves", robots=[1, 2], start_s=2.0, duration_s=0.5),
        fault("leaves", robots=[2], start_s=[4.0, 6.0]),
        fault("arrives-late", robots=[2]),
        fault("kill", robots=[2]),
    )
    scenario = load_scenario(find("2-crossing")).model_copy(update={"faults": faults})
    late, leaving = (robot.absences_s for robot in effective(scenario, seed=3).robots)
    assert late == ((0.0, 1.0), (2.0, 2.5))
    assert leaving[0] == (2.0, 2.5)
    [(begin_s, end_s)] = leaving[1:]
    assert 4.0 <= begin_s <= 6.0
    assert end_s == 1e5
    assert effective(scenario, seed=3) == effective(scenario, seed=3)
    assert effective(scenario, seed=4) != effective(scenario, seed=3)
    assert effective(scenario, seed=3).faults == faults
