"""What tests need of a machine: where it is missing they are skipped with the reason, but fail in CI."""

import os
import shutil
import sys

import pytest

IN_CI = "UNSPOKEN_CI"
"""Environment variable that ``.ci/run`` sets once it has installed what is needed."""


def why_not(packages: dict[str, str], *, root: bool = True) -> str:
    """Why a test cannot run here with these commands; empty if it can.

    Args:
        packages: the Debian package of each command.
        root: whether it needs to be root.
    """
    if sys.platform != "linux":
        return f"it needs Linux, this is {sys.platform}"
    if root and os.geteuid() != 0:
        return "it needs root"
    missing = [f"{command} (package {package})" for command, package in packages.items() if not _has(command)]
    return f"commands are missing: {', '.join(missing)}" if missing else ""


def _has(command: str) -> bool:
    return shutil.which(command, path=f"{os.environ['PATH']}:/usr/sbin:/sbin") is not None


def need(packages: dict[str, str], *, root: bool = True) -> None:
    """Skip the test unless it can run; in CI let it fail."""
    if reason := why_not(packages, root=root):
        assert not os.environ.get(IN_CI), f"not to be skipped in CI: {reason}"
        pytest.skip(reason)
