"""The bundled scenarios: each YAML file here can be run by its name."""

import os
from difflib import get_close_matches
from pathlib import Path

from protocol.scenario_file import ScenarioError


def bundled_scenarios() -> dict[str, Path]:
    """The files of the bundled scenarios by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.yaml"))}


def find(name_or_path: str) -> Path:
    """The file of a scenario given by the name of a bundled one or by a path.

    Raises:
        ScenarioError: it is neither; the text lists the bundled names and the nearest one.
    """
    bundled = bundled_scenarios()
    if name_or_path in bundled:
        return bundled[name_or_path]
    if os.path.exists(name_or_path):  # Path.exists raises for a name that no file system allows
        return Path(name_or_path)
    near = get_close_matches(Path(name_or_path).stem, bundled, n=1, cutoff=0.5)
    meant = f"; did you mean '{near[0]}'?" if near else ""
    raise ScenarioError(
        f"{name_or_path}: there is no such file and no bundled scenario of this name; "
        f"the bundled ones are {', '.join(bundled)}{meant}"
    )
