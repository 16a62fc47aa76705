"""What is compared: columns of a run's row, and the values that the runs of one scenario give together."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean

from fleet.evaluate.results import Row


@dataclass(frozen=True)
class Measure:
    """One figure of a run.

    Attributes:
        column: of the row.
        name: as tables say it, with its unit.
        unit: of the figure.
        of_seeds: makes one value of those of a scenario's seeds.
        unfinished: whether runs in which not all robots arrived tell it too.
    """

    column: str
    name: str
    unit: str
    of_seeds: Callable[[Iterable[float]], float] = fmean
    unfinished: bool = False


DURATION = Measure("duration_s", "duration", "s")
ROBOT_DURATION = Measure("robot_duration_mean_s", "mean duration per robot", "s")
DRIVEN = Measure("driven_m", "driven by all", "m")
ROBOT_DRIVEN = Measure("robot_driven_mean_m", "driven per robot", "m")
SMALLEST_DISTANCE = Measure("minimum_distance_m", "smallest distance", "m", min, unfinished=True)
MEASURES = (DURATION, ROBOT_DURATION, DRIVEN, ROBOT_DRIVEN, SMALLEST_DISTANCE)
PHASES = ("estimate", "predict", "plan", "decide")


def cpu_time(phase: str, statistic: str) -> Measure:
    """The CPU time of one phase of a decision, such as the ``p99`` of ``plan``."""
    return Measure(f"{phase}_cpu_{statistic}_ms", f"{phase}, {statistic}", "ms", unfinished=True)


@dataclass(frozen=True)
class Group:
    """All runs of one method at one level of noise, in the order of the evaluation.

    The unit of all statistics is the scenario: seeds of one scenario are no independent samples, so they
    count as one value.
    """

    method: str
    noise: str
    rows: Sequence[Row]

    def by_scenario(self, measure: Measure) -> dict[str, float]:
        """One value a scenario, for those that have one."""
        values: dict[str, list[float]] = {}
        for row in self.rows:
            value = getattr(row, measure.column)
            if value is not None and (measure.unfinished or all_arrived(row)):
                values.setdefault(row.scenario, []).append(value)
        return {scenario: measure.of_seeds(each) for scenario, each in values.items()}

    @property
    def scenarios(self) -> list[str]:
        """Those with a run."""
        return list(dict.fromkeys(row.scenario for row in self.rows))

    @property
    def unfinished(self) -> set[str]:
        """Scenarios with a run in which not all robots arrived, or that failed."""
        return {row.scenario for row in self.rows if not all_arrived(row)}

    @property
    def collided(self) -> set[str]:
        """Scenarios with a run in which robots collided."""
        return {row.scenario for row in self.rows if row.collisions}


def all_arrived(row: Row) -> bool:
    """Whether every robot came to its goal, with or without collisions on the way."""
    return row.duration_s is not None
