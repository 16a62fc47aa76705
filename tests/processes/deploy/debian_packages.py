"""A folder of unpacked Debian packages of any architecture; the packages of the machine stay as they are."""

import subprocess
from pathlib import Path

COMMANDS = {"apt-get": "apt", "dpkg-deb": "dpkg"}
"""And where they come from."""


def unpack(folder: Path, architecture: str, *packages: str) -> Path:
    """Unpack packages and all that they depend on, from where this machine gets its own.

    Args:
        folder: for the lists of packages, the packages, and what is in them.
        architecture: as Debian names it: ``amd64``, ``arm64``.
        packages: their names.

    Returns:
        The folder in which they are unpacked.
    """
    root, archives = folder / "root", folder / "cache" / "archives"
    for new in (root, archives / "partial", folder / "state" / "lists" / "partial"):
        new.mkdir(parents=True)
    (folder / "state" / "status").touch()  # nothing is installed, so that all dependencies come along
    settings = {
        "APT::Architecture": architecture,
        "APT::Architectures": architecture,
        "APT::Install-Recommends": "false",
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
        "Debug::NoLocking": "true",
        "Dir::Cache": folder / "cache",
        "Dir::State": folder / "state",
        "Dir::State::status": folder / "state" / "status",
    }
    apt = ["apt-get", "--quiet", *(f"--option={name}={value}" for name, value in settings.items())]
    _run(*apt, "update")
    _run(*apt, "install", "--yes", "--download-only", *packages)
    for package in archives.glob("*.deb"):
        _run("dpkg-deb", "--extract", package, root)
    return root


def _run(*command: object) -> None:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
