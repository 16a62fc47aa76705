"""Which processes of a run are to have faults, and what they are told of them."""

from pathlib import Path

from fleet.inject.effective import effective
from fleet.inject.link import link_faults
from fleet.inject.robot_mind import mind_faults
from fleet.inject.schedule import schedule
from fleet.inject.told import write_faults
from fleet.run.experiment import Experiment
from protocol.faults import ClockStep
from protocol.scenario import scenario_text


class Faults:
    """The faults of one run in processes; without any, nobody is told of any.

    Args:
        experiment: what is run.
        directory: for the files that processes are told of; it outlives the run.

    Raises:
        OSError: they cannot be written.

    Attributes:
        scenario: what the world drives: the scenario's file, or one with what its faults make of it.
        told: settings of a process that has faults.
    """

    def __init__(self, experiment: Experiment, directory: Path) -> None:
        scenario, seed = experiment.scenario, experiment.facts.seed
        self._scheduled = schedule(scenario.faults, seed=seed, step_s=scenario.step_s)
        self.scenario = experiment.path
        self.told: dict[str, str] = {}
        if scenario.faults:
            self.scenario = directory / "scenario.yaml"
            self.scenario.write_text(scenario_text(effective(scenario, seed)), encoding="utf-8")
            write_faults(directory / "faults.json", scenario.faults)
            self.told = {"faults": str(directory / "faults.json"), "seed": str(seed)}

    def on_link(self, robot: str) -> bool:
        """Whether one of them lies between the world and a robot."""
        return bool(link_faults(self._scheduled, robot))

    def on_robot(self, robot: str) -> bool:
        """Whether one of them lies on the process of a robot."""
        clocks = (each for each in self._scheduled if isinstance(each.fault, ClockStep))
        return bool(mind_faults(self._scheduled, robot)) or any(each.befalls(robot) for each in clocks)
