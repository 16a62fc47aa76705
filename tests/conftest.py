"""Property tests are not judged by the clock: the machine is shared. In CI they repeat the same examples.

The solver is compiled once, which takes more than a minute on a fresh clone. Meanwhile those tests run that
do not need it.
"""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import settings

from agent.process.warm import compile_in_background

HERE = Path(__file__).parent
WITHOUT_SOLVER = [
    HERE / folder
    for folder in (
        "unit",
        "processes/deploy",
        "processes/silence",
        "processes/world",
        "unit/chassis",
        "unit/protocol",
        "unit/world",
    )
]

# Started in the background (nohup, a shell's &) the tests come with these ignored, and so would every process
# that a test starts: Ctrl-C could not be tested.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

settings.register_profile("unspoken", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if {"CI", "UNSPOKEN_CI"} & os.environ.keys() else "unspoken")


def _needs_solver(path: Path) -> bool:
    return path.parent not in WITHOUT_SOLVER


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Those that need no solver come first: of several workers, the first one gets them."""
    items.sort(key=lambda item: _needs_solver(item.path))


@pytest.fixture(scope="module", autouse=True)
def _compiled_solver(request: pytest.FixtureRequest) -> None:
    """Compiled before the first test that needs it; of the processes that share the tests, one does it."""
    if _needs_solver(request.path):
        compile_in_background(unwanted=lambda: False)


@pytest.fixture
def temporary() -> Iterator[Path]:
    """A temporary directory with a short path: that of a socket holds about a hundred characters."""
    with TemporaryDirectory(prefix="u") as folder:
        yield Path(folder)


@pytest.fixture
def endpoint(temporary: Path) -> str:
    """A socket of this test alone."""
    return f"unixsock-stream/{temporary}/s"
