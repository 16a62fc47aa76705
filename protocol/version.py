"""The versions that can be told: that of what is said on the bus, and that of the installed software."""

from importlib.metadata import PackageNotFoundError, version
from typing import Final

PROTOCOL_VERSION: Final = 1
"""Of all messages and keys together; ``docs/protocol.md`` says when it changes."""

_DISTRIBUTIONS = ("unspoken", "unspoken-agent", "unspoken-world")
"""By what name the software is installed: whole, or only what a device or the image of the world needs."""


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


def disagreement(robot: str, its: int, the_worlds: int) -> str:
    """What robot and world both tell where they speak different versions of the protocol.

    Args:
        robot: its id.
        its: the version that the robot speaks.
        the_worlds: the version that the world speaks.
    """
    behind = "the world" if the_worlds < its else f"robot {robot}"
    return (
        f"robot {robot} speaks version {its} of the protocol, the world version {the_worlds}; update the "
        f"software of {behind}"
    )
