"""The versions that can be told: that of what is said on the bus, and that of the installed software."""

from importlib.metadata import PackageNotFoundError, version
from typing import Final

PROTOCOL_VERSION: Final = 1
"""Of all messages and keys together; ``docs/protocol.md`` says when it changes."""

_DISTRIBUTIONS = ("unspoken", "unspoken-agent")
"""By what name the software is installed: whole, or on a device."""


def software_version() -> str:
    """The version of the installed software, for people."""
    for name in _DISTRIBUTIONS:
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return "not installed"


def version_text() -> str:
    """What ``unspoken --version`` tells."""
    return f"unspoken {software_version()}, protocol {PROTOCOL_VERSION}"
