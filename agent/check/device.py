"""The check of a device from its first item to its last, and its short items."""

import ctypes
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import typer

from agent.check import Finding, is_ready, verdict
from agent.check.speed import check_speed
from agent.check.world import check_world
from agent.process.options import RobotOptions
from agent.solve import compiled
from chassis.refusal import Refusal
from protocol.identity import RENEW, DeviceKeys, Identity, client_identity, date_text, is_local
from protocol.version import version_text

PAUSE_S = 0.05
"""In which the steady clock has to advance by about as much."""
MOST_S = 5.0
"""A busy device may wake up late."""
_TIMEX_BYTES = 512
"""More than the kernel's struct timex has anywhere."""
_TIME_ERROR = 5
"""What adjtimex returns as long as nobody keeps the clock right."""


def check_device(options: RobotOptions, config: Path | None, *, as_json_text: bool) -> bool:
    """Print what is found, item by item or at the end as JSON; return whether this device is ready."""
    found: list[Finding] = []
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    for finding in findings(options, config):
        found.append(finding)
        if not as_json_text:
            typer.echo(finding.line(width))
    ready = is_ready(found)
    items = [each._asdict() for each in found]
    content = {"ready": ready, "items": items}
    typer.echo(json.dumps(content, ensure_ascii=False, indent=2) if as_json_text else verdict(found))
    return ready


def findings(options: RobotOptions, config: Path | None) -> Iterator[Finding]:
    """All items, those first on which others depend; options that are not valid have been refused before."""
    now = datetime.now(UTC)
    where = f"from {config}, environment and command line" if config else "no file"
    robot = f"robot {options.robot} of run {options.run!r}, goals {options.goals}, solver {options.solver}"
    yield Finding("configuration", "ok", f"{robot}; {where}; {version_text()}")
    credentials, identity = check_credentials(options, now)
    yield credentials
    installed = datetime.fromtimestamp(Path(__file__).stat().st_mtime, UTC)
    yield check_wall_clock(now, installed, is_synchronised())
    yield check_steady_clock()
    world, scene = check_world(options, identity, proven=credentials.state != "failed")
    yield world
    kernels = check_kernels(compiled.is_complete(), compiled.FOLDER, compiled.processor(), compiled.places())
    yield kernels
    if kernels.state == "ok":
        yield check_speed(options, scene)
    else:
        yield Finding("decision time", "warning", "not measured, since kernels are missing")


def check_credentials(options: RobotOptions, now: datetime) -> tuple[Finding, Identity]:
    """Whether the device can prove that it is this robot; the identity is none where it cannot."""
    item = "credentials"
    try:
        identity = client_identity(options.robot, options.connect, options.password_file, options.keys, now)
    except Refusal as refusal:
        return Finding(item, "failed", str(refusal)), None
    if isinstance(identity, DeviceKeys):
        valid = f"valid until {date_text(identity.expires)}"
        text = f"keys of robot {identity.name} in {identity.folder}, {valid}"
        if identity.expire_soon(now):
            return Finding(item, "warning", text, RENEW), identity
        return Finding(item, "ok", text), identity
    if not is_local(options.connect):
        text = f"nothing is encrypted on the way to {options.connect}: who listens can pass for this robot"
        remedy = "use keys, as 'unspoken keys create' makes them, and an endpoint tls/…"
        return Finding(item, "warning", text, remedy), identity
    if identity is None:
        return Finding(item, "ok", "none, for a world on this machine that asks for none"), None
    return Finding(item, "ok", f"password in {options.password_file}"), identity


def is_synchronised() -> bool | None:
    """Whether the kernel holds the clock for synchronised; None where it does not say, as outside Linux."""
    adjtimex = getattr(ctypes.CDLL(None), "adjtimex", None)
    if adjtimex is None:
        return None
    state = adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))  # all zero: it asks, and sets nothing
    return None if state < 0 else state != _TIME_ERROR


def check_wall_clock(now: datetime, installed: datetime, synchronised: bool | None) -> Finding:
    """Whether the time of day can be right: keys have a time. It cannot be that before the installation."""
    item, says = "clock", f"it says {date_text(now)}"
    if now < installed:
        text = f"{says}, which is before this software was installed ({date_text(installed)})"
        return Finding(item, "failed", text, "set the clock")
    if synchronised is False:
        services = "chrony or systemd-timesyncd"
        remedy = f"let a time service run, such as {services}: keys are not valid at a wrong time"
        return Finding(item, "warning", f"{says}, and nothing keeps it right", remedy)
    if synchronised:
        return Finding(item, "ok", f"synchronised, {says}, as the kernel says")
    return Finding(item, "ok", f"{says}, and the kernel does not tell whether it is kept right")


def check_steady_clock(
    now_s: Callable[[], float] = time.perf_counter, pause: Callable[[float], None] = time.sleep
) -> Finding:
    """Whether the clock that times decisions advances."""
    begin_s = now_s()
    pause(PAUSE_S)
    passed_s = now_s() - begin_s
    text = f"{1000.0 * passed_s:.0f} ms passed in a pause of {1000.0 * PAUSE_S:.0f} ms"
    if 0.9 * PAUSE_S <= passed_s <= MOST_S:
        return Finding("steady clock", "ok", text)
    remedy = "decisions cannot be timed; look at the clock source of this device"
    return Finding("steady clock", "failed", text, remedy)


def check_kernels(complete: bool, folder: Path, processor: str, places: Iterable[Path]) -> Finding:
    """Whether all that a robot needs is compiled, in its folder; other places may hold what others need."""
    item = "kernels"
    if complete:
        return Finding(item, "ok", f"compiled for this processor ({processor}) in {folder}")
    others = [place for place in places if any(place.glob("kernels-*/complete"))]
    found = f"not compiled for this software and this processor ({processor})"
    if others:
        found += f"; what lies in {others[0]} is for others"
    if compiled.is_writable(folder):
        command = f"{sys.executable} -m agent.process.warm"
        return Finding(item, "failed", found, f"the first start would take about a minute; run: {command}")
    remedy = "set NUMBA_CACHE_DIR to a folder that can be, or install what was compiled on such a processor"
    return Finding(item, "failed", f"{found}, and {folder} cannot be written", remedy)
