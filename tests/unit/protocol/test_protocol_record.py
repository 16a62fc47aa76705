"""Whatever crosses a process boundary changes with the version of the protocol, or not at all."""

import json
from typing import Any

import pytest
from recorded_protocol import RECORDS, as_text, protocol, record_of

from protocol.version import PROTOCOL_VERSION

HELP = """
What robots, world and bench say to each other has changed ({changed}), and the version of the
protocol has not. Those with other software would refuse each other's messages without a clear word. So:
- if no release has version {version} yet, run 'python tests/unit/protocol/recorded_protocol.py';
- otherwise raise PROTOCOL_VERSION in protocol/version.py to {next} before you run it, and keep the record
  of version {version} as it is.
docs/protocol.md says more.
"""


def changes(recorded: dict[str, Any], present: dict[str, Any]) -> list[str]:
    """What differs, such as ``messages.Command``."""
    return sorted(
        f"{part}.{name}"
        for part in recorded.keys() | present.keys()
        for name in recorded.get(part, {}).keys() | present.get(part, {}).keys()
        if recorded.get(part, {}).get(name) != present.get(part, {}).get(name)
    )


def test_what_is_said_on_the_bus_is_what_is_recorded_for_this_version() -> None:
    record = record_of(PROTOCOL_VERSION)
    recorded = json.loads(record.read_text(encoding="utf-8")) if record.exists() else {}
    changed = changes(recorded, json.loads(as_text(protocol())))
    if changed:
        told = {"changed": ", ".join(changed), "version": PROTOCOL_VERSION, "next": PROTOCOL_VERSION + 1}
        pytest.fail(HELP.format(**told), pytrace=False)
    versions = range(1, PROTOCOL_VERSION + 1)
    assert {path.stem for path in RECORDS.glob("*.json")} == set(map(str, versions))
