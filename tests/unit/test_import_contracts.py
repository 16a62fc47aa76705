"""The rules between the packages hold, and the checker notices when one of them is broken."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINT_IMPORTS = Path(sys.executable).parent / "lint-imports"

FORBIDDEN = [
    ("protocol", "world"),
    ("protocol", "agent"),
    ("protocol", "fleet"),
    ("world", "agent"),
    ("world", "fleet"),
    ("agent", "world"),
    ("agent", "fleet"),
    ("agent", "protocol.scenario"),
    ("agent", "protocol.scenario"),
    ("agent", "scenarios"),
    ("protocol", "scenarios"),
]
"""Who may not import whom, as the architecture states it."""


@pytest.fixture
def copy(tmp_path):
    """A copy of the packages that a test may break."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for package in ("protocol", "world", "agent", "fleet", "scenarios"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def lint_imports(directory):
    return subprocess.run([LINT_IMPORTS, "--no-cache"], cwd=directory, capture_output=True, text=True)


def test_all_contracts_are_kept(copy):
    checked = lint_imports(copy)
    assert checked.returncode == 0, checked.stdout
    assert "Contracts: 4 kept, 0 broken." in checked.stdout


@pytest.mark.parametrize(("importer", "imported"), FORBIDDEN)
def test_a_forbidden_import_is_noticed(copy, importer, imported):
    (copy / importer / "newcomer.py").write_text(f"import {imported}\n")
    checked = lint_imports(copy)
    assert checked.returncode == 1
    assert f"{importer}.newcomer -> {imported}" in checked.stdout


def test_a_forbidden_import_by_way_of_another_module_is_noticed(copy):
    (copy / "protocol" / "newcomer.py").write_text("import protocol.scenario\n")
    (copy / "agent" / "newcomer.py").write_text("import protocol.newcomer\n")
    checked = lint_imports(copy)
    assert checked.returncode == 1
    assert "protocol.newcomer -> protocol.scenario" in checked.stdout
