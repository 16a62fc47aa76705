"""The bundled scenarios: each YAML file here can be run by its name, each directory of them is a suite."""

import os
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path

from chassis.refusal import Refusal

HERE = Path(__file__).parent


def bundled_scenarios() -> dict[str, Path]:
    """The files of the bundled scenarios by name."""
    return {path.stem: path for path in sorted(HERE.glob("*.yaml"))}


def bundled_suites() -> dict[str, Path]:
    """The directories of the bundled suites by name."""
    return {path.name: path for path in sorted({file.parent for file in HERE.glob("*/*.yaml")})}


def find(name_or_path: str) -> Path:
    """The file of a scenario given by the name of a bundled one or by a path.

    Raises:
        Refusal: it is neither; the text lists the bundled names and the nearest one.
    """
    return _find(name_or_path, bundled_scenarios(), "file and no bundled scenario")


def find_suite(name_or_path: str) -> Path:
    """The directory of a suite, or the file of a single scenario, given by a bundled name or by a path.

    Raises:
        Refusal: as for ``find``.
    """
    bundled = bundled_suites() | bundled_scenarios()
    return _find(name_or_path, bundled, "file or directory and no bundled suite or scenario")


def _find(name_or_path: str, bundled: Mapping[str, Path], kind: str) -> Path:
    if name_or_path in bundled:
        return bundled[name_or_path]
    if os.path.exists(name_or_path):  # Path.exists raises for a name that no file system allows
        return Path(name_or_path)
    near = get_close_matches(Path(name_or_path).stem, bundled, n=1, cutoff=0.5)
    meant = f"; did you mean '{near[0]}'?" if near else ""
    raise Refusal(
        f"{name_or_path}: there is no such {kind} of this name; "
        f"the bundled ones are {', '.join(bundled)}{meant}"
    )
