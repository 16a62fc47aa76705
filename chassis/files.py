"""Files that are never seen half written, and the base of the records in them."""

import os
from pathlib import Path

from pydantic import BaseModel, ConfigDict


class Record(BaseModel):
    """Base of what is said on the bus, written by hand or kept: exactly these fields, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def write_private(path: Path, text: str) -> None:
    """Write a new file that only its owner can read, from its first byte on and whatever the umask.

    Raises:
        OSError: it exists, or cannot be written.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is there with all of its content, or else stays as it was.

    Raises:
        OSError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
