"""Whether all is compiled that a robot on this device needs."""

import sys
from collections.abc import Iterable
from pathlib import Path

from agent.check.findings import Finding
from agent.solve import compiled

ITEM = "kernels"


def check_kernels() -> Finding:
    """The compiled kernels of this software for this processor."""
    return judged(compiled.is_complete(), compiled.FOLDER, compiled.processor(), compiled.places())


def judged(complete: bool, folder: Path, processor: str, places: Iterable[Path]) -> Finding:
    """What to say of them.

    Args:
        complete: whether all of them are in their folder.
        folder: named after the software and the processor.
        processor: for people.
        places: where folders of other software or another processor may lie.
    """
    if complete:
        return Finding(ITEM, "ok", f"compiled for this processor ({processor}) in {folder}")
    others = [place for place in places if any(place.glob("kernels-*/complete"))]
    found = f"not compiled for this software and this processor ({processor})"
    if others:
        found += f"; what lies in {others[0]} is for others"
    if compiled.is_writable(folder):
        command = f"{sys.executable} -m agent.process.warm"
        return Finding(ITEM, "failed", found, f"the first start would take about a minute; run: {command}")
    return Finding(
        ITEM,
        "failed",
        f"{found}, and {folder} cannot be written",
        "set NUMBA_CACHE_DIR to a folder that can be, or install what was compiled on such a processor",
    )
