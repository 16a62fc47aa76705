"""Places for runs in real processes."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from process_helpers import Bench, Process


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Start ``unspoken …``, with what it prints in a directory of this name; it ends with the test."""
    with ExitStack() as processes:
        yield lambda name, *arguments, **options: processes.enter_context(
            Process(tmp_path / name, *arguments, **options)
        )


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    """Start ``unspoken …`` with its output in a directory of this name; it ends with the test."""
    with ExitStack() as benches:
        yield lambda name, *arguments, **options: benches.enter_context(
            Bench(tmp_path / name, *arguments, **options)
        )
