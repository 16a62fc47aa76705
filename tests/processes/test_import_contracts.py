"""The checker of the rules between the packages notices when one of them is broken."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINT_IMPORTS = Path(sys.executable).parent / "lint-imports"

FORBIDDEN = [
    ("chassis", "protocol"),
    ("protocol", "world"),
    ("protocol", "agent"),
    ("protocol", "fleet"),
    ("protocol", "scenarios"),
    ("world", "agent"),
    ("world", "fleet"),
    ("world", "scenarios"),
    ("agent", "world"),
    ("agent", "fleet"),
    ("agent", "scenarios"),
    ("agent", "protocol.scenario"),
]
"""Who may not import whom, as the architecture states it."""


@pytest.fixture
def copy(tmp_path):
    """A copy of the packages that a test may break."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for package in ("chassis", "protocol", "world", "agent", "fleet", "scenarios"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_every_forbidden_import_is_noticed_also_by_way_of_another_module(copy):
    """That there are none is what ``make check`` finds."""
    forbidden = [
        (importer, imported, f"newcomer_for_{imported.replace('.', '_')}") for importer, imported in FORBIDDEN
    ]
    for importer, imported, newcomer in forbidden:
        (copy / importer / f"{newcomer}.py").write_text(f"import {imported}\n")
    (copy / "protocol" / "newcomer.py").write_text("import protocol.scenario\n")
    (copy / "agent" / "newcomer.py").write_text("import protocol.newcomer\n")
    checked = subprocess.run([LINT_IMPORTS, "--no-cache"], cwd=copy, capture_output=True, text=True)
    assert checked.returncode == 1
    for importer, imported, newcomer in forbidden:
        assert f"{importer}.{newcomer} -> {imported}" in checked.stdout
    assert "agent.newcomer -> protocol.newcomer" in checked.stdout
    assert "protocol.newcomer -> protocol.scenario" in checked.stdout
