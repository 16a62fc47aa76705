"""Numerical kernels: Python functions that numba compiles, once on a machine, and keeps on disk.

Compiling all of them takes the better part of a minute, so it happens before a robot starts (``agent.warm``)
and never during a run. A kernel takes C-contiguous float64 and int64 arrays and scalars, whose sizes may
differ from call to call without anything being compiled again.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent
_kernels: list[Any] = []


def kernel(function: Function) -> Function:
    """Compile a function at its first call; its compiled form is kept on disk.

    Divisions by zero give infinities and NaN instead of errors, sums may be reordered (so that they use the
    vector units), and other threads run meanwhile.
    """
    compiled = numba.njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})(
        function
    )
    _kernels.append(compiled)
    return cast(Function, compiled)


def forbid_compiling() -> None:
    """From now on a kernel called with types it was not compiled for raises a TypeError, compiling nothing."""
    for each in _kernels:
        each.disable_compile()


def _cache_directory() -> Path:
    """Where compiled kernels are kept: beside the package, else (read-only installations) with the user.

    One directory for each state of the modules with kernels: numba alone would keep a kernel whose callee in another file
    has changed.
    """
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        content = source.read_bytes()
        if b"agent.compiled" in content:
            digest.update(content)
    name = f"kernels-{digest.hexdigest()[:16]}"
    beside = _PACKAGE / "__pycache__"
    if os.access(beside if beside.exists() else _PACKAGE, os.W_OK):
        return beside / name
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "unspoken" / name


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(_cache_directory())  # type: ignore[attr-defined]  # set by name at import
