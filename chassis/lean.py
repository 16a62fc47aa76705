"""Packages loaded without others that they would load, too, only because these are there.

A robot's process begins half a second sooner, since nothing in it uses those.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast


@contextmanager
def hidden(package: str) -> Iterator[None]:
    """Meanwhile a package seems not to be installed, unless it is loaded already."""
    modules = cast(dict[str, Any], sys.modules)
    if package in modules:
        yield
        return
    modules[package] = None
    try:
        yield
    finally:
        del modules[package]


with hidden("rich"):  # for colours in tracebacks, in development
    import structlog as structlog
