"""The images, built without network access: from a base made of Debian packages, and from wheels."""

import shutil
import subprocess
import sys
from pathlib import Path

import debian_packages
from container_engine import Engine

ROOT = Path(__file__).parents[3]
BASE = "python:3.11-slim"
"""The one that the Containerfile names, so that it is built as it is."""
_PACKAGES = ("python3.11-venv", "libstdc++6", "dash", "coreutils")
OFFLINE = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "/source/wheels"}


def copy_sources(folder: Path) -> Path:
    """What git knows of the repository, and the wheels of all that the images hold."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", "wheels", "--only-binary", ":all:"]
    pinned = ["--constraint", "constraints.txt", "--python-version", "3.11", "setuptools>=77", "."]
    subprocess.run([*pip, *pinned], cwd=folder, check=True)
    return folder


def import_base(engine: Engine, folder: Path) -> None:
    """Make the base image, which cannot be pulled here."""
    root = debian_packages.unpack(folder, "amd64", *_PACKAGES)
    (root / "usr" / "local" / "bin").mkdir(parents=True, exist_ok=True)
    (root / "usr" / "local" / "bin" / "python").symlink_to("/usr/bin/python3.11")
    certificates = root / "etc" / "ssl" / "certs" / "ca-certificates.crt"
    certificates.parent.mkdir(parents=True, exist_ok=True)
    certificates.touch()  # pip wants them to be there, also where it connects to nobody
    (root / "tmp").mkdir(exist_ok=True)
    archive = folder / "base.tar"
    subprocess.run(["tar", "--create", "--file", archive, "--directory", root, "."], check=True)
    engine.docker("import", "--change", "ENV PATH=/usr/local/bin:/usr/bin:/bin", archive, BASE)
