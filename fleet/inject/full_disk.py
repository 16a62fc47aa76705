"""A disk that takes nothing more from a step on, for the recording of a run."""

import errno
import io
import os
from collections.abc import Sequence
from pathlib import Path

from fleet.inject.schedule import schedule
from protocol.faults import DiskFull, Fault


class FullDisk:
    """Opens the file of a recording, and refuses to write to it once the disk is to be full.

    Args:
        faults: of the run; those of the disk count.
        seed: of the run.
        step_s: Δt in s.
    """

    def __init__(self, faults: Sequence[Fault], *, seed: int, step_s: float) -> None:
        scheduled = schedule(faults, seed=seed, step_s=step_s)
        self._begins = [each.begin for each in scheduled if isinstance(each.fault, DiskFull)]
        self.is_full = False

    def at(self, step: int) -> None:
        """The run has come to this step."""
        self.is_full = self.is_full or any(begin <= step for begin in self._begins)

    def open(self, path: Path) -> io.BufferedWriter:
        """The file, empty.

        Raises:
            OSError: it cannot be opened.
        """
        return io.BufferedWriter(_File(path, self))


class _File(io.FileIO):
    def __init__(self, path: Path, disk: FullDisk) -> None:
        super().__init__(path, "wb")
        self._disk = disk

    def write(self, data: object, /) -> int:
        if self._disk.is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)  # type: ignore[arg-type]  # a buffer, which typing names from 3.12 on
