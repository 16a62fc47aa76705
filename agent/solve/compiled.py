"""Numerical kernels: Python functions that numba compiles, once on a machine, and keeps on disk.

Compiling all of them takes the better part of a minute, so it happens before a robot starts
(``agent.process.warm``) and never during a run. A kernel takes C-contiguous float64 and int64 arrays and
scalars, whose sizes may differ from call to call without anything being compiled again.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import UserProvidedCacheLocator
from numba.core.registry import cpu_target

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parents[1]
OPTIMISATION = 1
"""Of numba's 0 to 3: more costs a quarter more time to compile and makes no kernel faster."""
_COMPLETE = "complete"
_WITH_KERNELS = re.compile(rf"^from {re.escape(__name__)} import kernel$", re.MULTILINE)
# A class alone is no part of a kernel: those that are, named tuples, stand in modules with kernels.
_IMPORT = re.compile(r"^from (\S+) import (?![A-Z][a-z]\w*$)", re.MULTILINE)
_kernels: list[Any] = []

_config: Any = numba.config
_config.OPT = type(_config.OPT)(OPTIMISATION)


def kernel(function: Function) -> Function:
    """Compile a function at its first call; its compiled form is kept on disk.

    Divisions by zero give infinities and NaN instead of errors, and other threads run meanwhile. Sums are
    kept in the order in which they are written: reordered ones differ in their last bits with the addresses
    of arrays, and robots with the same data must decide the same.
    """
    compiled = numba.njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})(function)
    _kernels.append(compiled)
    return cast(Function, compiled)


def forbid_compiling() -> None:
    """From now on a kernel called with types it was not called with before raises a TypeError."""
    for each in _kernels:
        if each.signatures:  # the others are called by kernels only
            each.disable_compile()


def is_complete() -> bool:
    """Whether all kernels are on disk."""
    return (FOLDER / _COMPLETE).exists()


def mark_complete() -> None:
    """All kernels have been compiled and kept."""
    (FOLDER / _COMPLETE).touch()


def sources() -> list[Path]:
    """The modules with kernels and those from which they import: all that compiled code is made of."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(_PACKAGE.rglob("*.py"))}
    kernels = {path for path, text in texts.items() if _WITH_KERNELS.search(text)}
    imported = {name for path in kernels for name in _IMPORT.findall(texts[path])}
    return [path for path in texts if path in kernels or _module(path) in imported]


def _module(path: Path) -> str:
    return ".".join((_PACKAGE.name, *path.relative_to(_PACKAGE).with_suffix("").parts))


def processor() -> str:
    """The processor for which kernels are compiled, for people."""
    return str(_target()[1])


def _target() -> tuple[str, ...]:
    """As numba itself tells processors apart: kind of machine, name, features."""
    return cast(tuple[str, ...], cpu_target.target_context.codegen().magic_tuple())


def _state() -> str:
    """A name for the state of what compiled code depends on: sources, libraries and processor.

    numba alone would keep a kernel although a function or a constant in another file has changed.
    """
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources()))
    digest.update(repr((numba.__version__, sys.implementation.cache_tag, _target())).encode())
    return f"kernels-{digest.hexdigest()[:16]}"


def places() -> list[Path]:
    """Where kernels may be kept: where the user says, or else beside the package or with the user."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return [Path(chosen).absolute()]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return [_PACKAGE / "__pycache__", Path(home).absolute() / "unspoken"]


def is_writable(folder: Path) -> bool:
    """Whether files can be put into a folder, which need not be there yet."""
    there = next(each for each in (folder, *folder.parents) if each.exists())
    return there.is_dir() and os.access(there, os.W_OK)


def chosen_folder(places: Iterable[Path], name: str) -> Path:
    """The first place that holds all kernels, else the first that can be written, else the first."""
    folders = [place / name for place in places]
    complete = [folder for folder in folders if (folder / _COMPLETE).exists()]
    return [*complete, *filter(is_writable, folders), *folders][0]


FOLDER = chosen_folder(places(), _state())
"""Holds the compiled kernels of this state of the program, on this processor."""


class Locator(UserProvidedCacheLocator):
    """Lets numba look into ``FOLDER`` even where nothing can be written, as in a read-only container."""

    @classmethod
    def from_function(cls, py_func: object, py_file: str) -> "Locator":
        """Without the check of numba's own locators that the folder can be written."""
        return cls(py_func, py_file)

    def get_source_stamp(self) -> str:
        """The folder's name, which follows from the sources; their times change with every checkout."""
        return FOLDER.name


_config.CACHE_DIR = str(FOLDER)
_config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
