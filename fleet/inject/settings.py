"""What the processes of a run are told of its faults, in files that outlive it."""

import os
from pathlib import Path

from fleet.inject.fault import Fault, Scheduled, of_kind, schedule
from fleet.inject.link import LINK_FAULTS
from fleet.inject.mind_faults import MIND_FAULTS
from fleet.inject.process_faults import ClockStep
from fleet.inject.scenario import FaultFile, Scenario, effective
from protocol.scenario import scenario_text
from protocol.scene import Scene


class FaultSettings:
    """What the processes of one run are told of its faults; without any, nothing.

    Args:
        path: of the scenario.
        scenario: with its faults.
        seed: of the run.
        directory: for the files that processes are told of; it outlives the run.

    Raises:
        OSError: they cannot be written.

    Attributes:
        scenario: the file that the world drives: the scenario's, or one with what its faults make of it.
        settings: of a process that has faults; see :func:`faults_of_this_process`.
    """

    def __init__(self, path: Path, scenario: Scenario, seed: int, directory: Path) -> None:
        self._scheduled = schedule(scenario.faults, seed=seed, step_s=scenario.step_s)
        self.scenario = path
        self.settings: dict[str, str] = {}
        if scenario.faults:
            self.scenario, faults = directory / "scenario.yaml", directory / "faults.json"
            self.scenario.write_text(scenario_text(effective(scenario, seed)), encoding="utf-8")
            faults.write_text(FaultFile(faults=scenario.faults).model_dump_json(), encoding="utf-8")
            self.settings = {"faults": str(faults), "seed": str(seed)}

    def on_link(self, robot: str) -> bool:
        """Whether one of them lies between the world and a robot."""
        return bool(of_kind(self._scheduled, LINK_FAULTS, robot))

    def on_robot(self, robot: str) -> bool:
        """Whether one of them lies on the process of a robot."""
        return bool(of_kind(self._scheduled, (*MIND_FAULTS, ClockStep), robot))


def faults_of_this_process(scene: Scene) -> list[Scheduled[Fault]]:
    """All faults of the run, as this process was told of them by its environment.

    Raises:
        OSError: the file cannot be read.
        KeyError: it was not told of any.
    """
    text = Path(os.environ["UNSPOKEN_FAULTS"]).read_text(encoding="utf-8")
    faults = FaultFile.model_validate_json(text).faults
    return schedule(faults, seed=int(os.environ["UNSPOKEN_SEED"]), step_s=scene.step_s)
