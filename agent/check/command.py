"""The check of a device from its first item to its last."""

from collections.abc import Iterator
from datetime import UTC, datetime

import typer

from agent.check.clocks import check_steady_clock, check_wall_clock, installed_at, is_synchronised
from agent.check.credentials import check_credentials
from agent.check.findings import Device, Finding, is_ready, told_as_json
from agent.check.kernels import check_kernels
from agent.check.speed import check_speed
from agent.check.world import check_world
from protocol.version import version_text


def check_device(device: Device, *, as_json: bool) -> bool:
    """Say what is found, item by item.

    Args:
        device: its options.
        as_json: told at the end, as JSON, instead of line by line.

    Returns:
        Whether this device is ready.
    """
    found: list[Finding] = []
    for finding in findings(device):
        found.append(finding)
        if not as_json:
            typer.echo(finding.line())
    typer.echo(told_as_json(found) if as_json else verdict(found))
    return is_ready(found)


def findings(device: Device) -> Iterator[Finding]:
    """All items, those first on which others depend."""
    now = datetime.now(UTC)
    yield _configuration(device)
    credentials, identity = check_credentials(device, now)
    yield credentials
    yield check_wall_clock(now, installed_at(), is_synchronised())
    yield check_steady_clock()
    reached = check_world(device, identity, proven=credentials.state != "failed")
    yield reached.finding
    kernels = check_kernels()
    yield kernels
    if kernels.state == "ok":
        yield check_speed(device, reached.scene)
    else:
        yield Finding("decision time", "warning", "not measured, since kernels are missing")


def verdict(found: list[Finding]) -> str:
    """The last line for people."""
    failed, warned = (sum(each.state == state for each in found) for state in ("failed", "warning"))
    warnings = f", {warned} warning{'' if warned == 1 else 's'}" if warned else ""
    return f"ready{warnings}" if is_ready(found) else f"not ready: {failed} failed{warnings}"


def _configuration(device: Device) -> Finding:
    """Options that are not valid have been refused before."""
    where = f"from {device.config}, environment and command line" if device.config else "no file"
    told = (
        f"robot {device.robot} of run {device.run!r}, goals {device.goals}, solver {device.solver}; {where}"
    )
    return Finding("configuration", "ok", f"{told}; {version_text()}")
