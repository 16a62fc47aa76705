"""The scenario as the world drives it: with the faults by which robots are not there."""

from collections.abc import Iterator
from typing import Any

from fleet.inject.schedule import Scheduled, schedule
from protocol.faults import ArrivesLate, Leaves
from protocol.scenario import Scenario

END_S = 1e5
"""After the end of every run; the latest time that a scenario can tell."""


def effective(scenario: Scenario, seed: int) -> Scenario:
    """A scenario in which robots that arrive late or leave are absent meanwhile.

    Args:
        scenario: with its faults, which stay in the list.
        seed: of the run.
    """
    faults = schedule(scenario.faults, seed=seed, step_s=scenario.step_s)
    robots = [
        robot.model_copy(
            update={
                "absences_s": robot.absences_s
                + tuple(_absences_s([each for each in faults if each.befalls(robot.id)], scenario))
            }
        )
        for robot in scenario.robots
    ]
    return scenario.model_copy(update={"robots": robots})


def _absences_s(faults: list[Scheduled[Any]], scenario: Scenario) -> Iterator[tuple[float, float]]:
    for each in faults:
        begin_s = min(scenario.time_s(each.begin), END_S)
        end_s = END_S if each.end is None else min(scenario.time_s(each.end), END_S)
        if isinstance(each.fault, ArrivesLate) and begin_s > 0.0:
            yield 0.0, begin_s
        elif isinstance(each.fault, Leaves):
            yield begin_s, end_s
