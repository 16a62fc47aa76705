"""The agent on 64-bit Arm: its wheels, and under emulation its imports, its kernels and a decision."""

import json
import os
import subprocess
import sys
from pathlib import Path

import debian_packages
import one_decision
import pytest
from needed import need

from agent.solve.realtime.solver import TOLERANCE

ROOT = Path(__file__).parents[3]
DISTRIBUTION = ROOT / "deploy" / "agent"
EMULATOR = "qemu-aarch64-static"
DEBIAN_PYTHON = "3.11"
PYTHONS = ("3.11", "3.12", "3.13")
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")
"""All that pip is to take: with fewer it silently takes versions of years ago."""
PROCESSOR = {"QEMU_CPU": "cortex-a72", "NUMBA_CPU_NAME": "generic"}
"""Such as in a Raspberry Pi 4; compiled as for an image."""
LONGEST_S = 3000.0

pytestmark = pytest.mark.slow


def pip(*arguments: object, python: str) -> str:
    """What pip says about wheels for a Python on 64-bit Arm."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"),
            *("--implementation", "cp", "--python-version", python),
            *(f"--platform={platform}" for platform in PLATFORMS),
            *("--constraint", ROOT / "constraints.txt"),
            *arguments,
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("python", PYTHONS)
def test_there_are_wheels_for_all_that_an_agent_needs(python, tmp_path):
    """Of the pinned versions, which pip would refuse to leave for others."""
    told = pip(
        *("--dry-run", "--ignore-installed", "--target", tmp_path / "site", "--report", "-", DISTRIBUTION),
        python=python,
    )
    files = {
        each["metadata"]["name"].lower(): each["download_info"]["url"].rpartition("/")[2]
        for each in json.loads(told)["install"]
    }
    assert {"numba", "llvmlite", "numpy", "eclipse-zenoh", "cryptography"} <= files.keys()
    of_the_bench = {"casadi", "dask", "distributed", "matplotlib", "mcap", "pandas", "psutil", "scipy"}
    assert not of_the_bench & files.keys()
    del files["unspoken-agent"]
    assert all(name.endswith(("aarch64.whl", "none-any.whl")) for name in files.values()), files


@pytest.mark.timeout(LONGEST_S)
def test_an_agent_decides_on_arm_as_it_does_here(tmp_path):
    need({EMULATOR: "qemu-user-static"} | debian_packages.COMMANDS)
    root = debian_packages.unpack(tmp_path / "debian", "arm64", f"python{DEBIAN_PYTHON}", "libstdc++6")
    site = tmp_path / "site"
    pip("--target", site, DISTRIBUTION, python=DEBIAN_PYTHON)
    python = root / "usr" / "bin" / f"python{DEBIAN_PYTHON}"
    arm = decision(
        (EMULATOR, "-L", root, python),
        PYTHONHOME=root / "usr",
        PYTHONPATH=site,
        NUMBA_CACHE_DIR=tmp_path / "kernels",
        **PROCESSOR,
    )
    native = decision((sys.executable,), PYTHONPATH=ROOT)
    print(
        f"compiled in {arm['compiled_s']:.0f} s, decision {arm['decision_s']:.3f} s, "
        f"here {native['decision_s']:.3f} s"
    )
    assert arm["machine"] == "aarch64"
    assert arm["failed"] == native["failed"] == []
    assert arm["command"] == pytest.approx(native["command"], abs=TOLERANCE)
    assert arm["estimates"].keys() == set(one_decision.SCENE.robots)
    for robot, goal in arm["estimates"].items():
        assert goal == pytest.approx(native["estimates"][robot], abs=TOLERANCE), robot


def decision(python: tuple[object, ...], **env: object) -> dict:
    """What an agent decides on this Python."""
    done = subprocess.run(
        [*map(str, python), "-P", one_decision.__file__],
        env={"PATH": os.environ["PATH"], "HOME": os.environ["HOME"]} | {k: str(v) for k, v in env.items()},
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])
