"""The service units as systemd itself reads them."""

import ctypes
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from needed import need

import agent.__main__
import world.__main__
from agent.cli import app
from chassis.health import LONGEST_SILENCE_S
from chassis.process import LONGEST_START_S
from protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE

ROOT = Path(__file__).parents[3]
UNITS = ROOT / "deploy" / "systemd"
PAGE = ROOT / "docs" / "services.md"
NAMES = ("unspoken-agent.service", "unspoken-world.service")
OWN_UNITS = next(
    (p for p in map(Path, ("/usr/lib/systemd/system", "/lib/systemd/system")) if p.is_dir()), None
)
PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN = 65, 1
"""Since Linux 6.3; systemd keeps MemoryDenyWriteExecute=yes by this or by a filter."""


@pytest.fixture
def analyze():
    """Run systemd-analyze."""
    need({"systemd-analyze": "systemd"}, root=False)
    return lambda *arguments: subprocess.run(
        ["systemd-analyze", *map(str, arguments)], capture_output=True, text=True
    )


@pytest.fixture
def device(tmp_path):
    """The files of a device on which the units are installed."""
    units = tmp_path / "etc" / "systemd" / "system"
    units.mkdir(parents=True)
    for name in NAMES:
        shutil.copy(UNITS / name, units / name)
        [command] = of(name, "ExecStart")
        program = tmp_path / shlex.split(command)[0].lstrip("/")
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
    shutil.copytree(OWN_UNITS, tmp_path / "usr" / "lib" / "systemd" / "system", symlinks=True)
    return tmp_path


def of(name, key):
    """All values of a setting of a unit, in their order."""
    lines = (UNITS / name).read_text().splitlines()
    return [line.partition("=")[2] for line in lines if line.startswith(f"{key}=")]


def seconds(name, key):
    [value] = of(name, key)
    number, unit = re.fullmatch(r"(\d+)(s|min)", value).groups()
    return float(number) * {"s": 1.0, "min": 60.0}[unit]


def environment(name):
    return dict(each.split("=", 1) for each in of(name, "Environment"))


@pytest.mark.parametrize("name", NAMES)
def test_systemd_accepts_the_unit(analyze, device, name):
    checked = analyze("verify", f"--root={device}", name)
    assert (checked.returncode, checked.stdout, checked.stderr) == (0, "", "")


@pytest.mark.parametrize("name", NAMES)
def test_the_unit_is_as_closed_as_the_page_says_and_nothing_bad_is_left_without_need(analyze, name):
    judged = analyze("security", "--offline=true", UNITS / name)
    [score] = re.findall(rf"exposure level for {re.escape(name)}: ([\d.]+)", judged.stdout)
    [recorded] = re.findall(rf"\| `{re.escape(name)}` \| ([\d.]+) \|", PAGE.read_text())
    assert float(score) <= float(recorded) <= 2.0
    needed = {
        "SystemCallFilter=~@resources",  # mbind alone
        "RootDirectory=/RootImage=",
        "PrivateMounts=",
        "PrivateNetwork=",
        "DeviceAllow=",
        "IPAddressDeny=",  # for the operator, who knows the address of the world
        *(f"RestrictAddressFamilies=~AF_{family}" for family in ("NETLINK", "UNIX", "(INET|INET6)")),
    }
    if name == NAMES[0]:
        needed |= {"MemoryDenyWriteExecute=", "ProcSubset="}
    judged = json.loads(analyze("security", "--offline=true", "--json=short", UNITS / name).stdout)
    assert {each["name"] for each in judged if not each["set"] and each["exposure"]} <= needed


def test_the_commands_that_are_started_exist():
    [starts_agent], [starts_world] = (of(name, "ExecStart") for name in NAMES)
    assert shlex.split(starts_agent) == ["/opt/unspoken/bin/unspoken", "agent"]
    assert "agent" in typer.main.get_command(app).commands
    assert shlex.split(starts_world) == ["/opt/unspoken/bin/python", "-P", "-m", "world"]


@pytest.mark.parametrize(("name", "main"), [(NAMES[0], agent.__main__.main), (NAMES[1], world.__main__.main)])
def test_each_process_is_told_what_it_knows_and_what_may_not_show_as_credentials(name, main):
    told = environment(name)
    single = typer.Typer()
    single.command()(main)
    assert set(told) - {"XDG_CACHE_HOME"} <= {each.envvar for each in typer.main.get_command(single).params}
    credentials = dict(each.split(":") for each in of(name, "LoadCredential"))
    assert told["UNSPOKEN_KEYS"] == "%d"
    assert {AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE} < set(credentials)
    assert {Path(value).name for value in told.values() if value.startswith("%d/")} < set(credentials)
    for credential, path in credentials.items():
        assert Path(path).name == credential
        assert path.startswith("/etc/unspoken/")


@pytest.mark.parametrize("name", NAMES)
def test_a_start_and_a_loop_that_go_on_have_time_enough(name):
    assert seconds(name, "TimeoutStartSec") > LONGEST_START_S
    assert seconds(name, "WatchdogSec") == LONGEST_SILENCE_S
    assert of(name, "Type") == ["notify"]
    assert of(name, "RestartPreventExitStatus") == ["2"]


def without_writable_code(*command):
    """Run a command in which no memory becomes executable that was not from its beginning."""

    def deny():
        if ctypes.CDLL(None).prctl(PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN, 0, 0, 0):
            os._exit(77)

    ran = subprocess.run([sys.executable, *command], preexec_fn=deny, capture_output=True, text=True)
    if ran.returncode == 77:
        pytest.skip("this kernel has no PR_SET_MDWE, which Linux has had since 6.3")
    return ran


def test_the_world_runs_without_writable_code_and_the_solver_cannot():
    assert without_writable_code("-m", "world", "--help").returncode == 0
    refused = without_writable_code("-c", "import agent.solve.compiled")
    assert refused.returncode != 0
    assert "executable memory" in refused.stderr
    assert [of(name, "MemoryDenyWriteExecute") for name in NAMES] == [[], ["yes"]]
