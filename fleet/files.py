"""Files that are never seen half written."""

import os
from pathlib import Path


def write_whole(path: Path, text: str) -> None:
    """Write a file that is there with all of its text, or else stays as it was.

    Raises:
        OSError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
