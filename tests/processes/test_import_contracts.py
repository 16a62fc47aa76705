"""The rules between the packages hold, and the checker notices when one of them is broken."""

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


def lint_imports(directory):
    return subprocess.run([LINT_IMPORTS, "--no-cache"], cwd=directory, capture_output=True, text=True)


def test_all_contracts_are_kept(copy):
    checked = lint_imports(copy)
    assert checked.returncode == 0, checked.stdout
    assert ", 0 broken." in checked.stdout


def test_every_forbidden_import_is_noticed(copy):
    for importer, imported in FORBIDDEN:
        newcomer = importer, f"newcomer_for_{imported.replace('.', '_')}"
        (copy / newcomer[0] / f"{newcomer[1]}.py").write_text(f"import {imported}\n")
    checked = lint_imports(copy)
    assert checked.returncode == 1
    for importer, imported in FORBIDDEN:
        assert f"{importer}.newcomer_for_{imported.replace('.', '_')} -> {imported}" in checked.stdout


def test_a_forbidden_import_by_way_of_another_module_is_noticed(copy):
    (copy / "protocol" / "newcomer.py").write_text("import protocol.scenario\n")
    (copy / "agent" / "newcomer.py").write_text("import protocol.newcomer\n")
    checked = lint_imports(copy)
    assert checked.returncode == 1
    assert "protocol.newcomer -> protocol.scenario" in checked.stdout
