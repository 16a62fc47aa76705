"""How the processes of a run are told of its faults: in a file that all of them share."""

import os
from collections.abc import Sequence
from pathlib import Path

from fleet.inject.schedule import Scheduled, schedule
from protocol.faults import Fault, FaultFile
from protocol.scene import Scene


def write_faults(path: Path, faults: Sequence[Fault]) -> None:
    """Write the file.

    Raises:
        OSError: it cannot be written.
    """
    path.write_text(FaultFile(faults=tuple(faults)).model_dump_json(), encoding="utf-8")


def faults_told(scene: Scene) -> list[Scheduled[Fault]]:
    """All faults of the run, as this process was told of them by its environment.

    Raises:
        OSError: the file cannot be read.
        KeyError: it was not told of any.
    """
    text = Path(os.environ["UNSPOKEN_FAULTS"]).read_text(encoding="utf-8")
    faults = FaultFile.model_validate_json(text).faults
    return schedule(faults, seed=int(os.environ["UNSPOKEN_SEED"]), step_s=scene.step_s)
