"""Every key expression of the bus, built here and nowhere else."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, StringConstraints, TypeAdapter, ValidationError

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
"""A robot's id or a run's name: it becomes one chunk of a key, so it holds no separator and no wildcard."""


def _as_text(value: object) -> object:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    return checked_name(text) if isinstance(text, str) else text


Id = Annotated[Name, BeforeValidator(_as_text)]
"""A robot's id in a file written by hand, where 1 stands for '1'."""

NAME_RULE = "1 to 32 letters, digits, '-' or '_' are expected, a letter or a digit first"
"""What a name looks like, for people."""

WORLD_NAME = "@world"
"""The world's name in its certificate; no robot can have it."""
BENCH_NAME = "@bench"
"""The bench's name in its certificate or beside its password; no robot can have it."""

_NAME = TypeAdapter(Name)


def checked_name(text: str) -> str:
    """The text, if it is a name; for command lines.

    Raises:
        ValueError: it is not; told in plain words.
    """
    try:
        return _NAME.validate_python(text)
    except ValidationError:
        raise ValueError(f"{text!r} found, {NAME_RULE}") from None


@dataclass(frozen=True)
class Keys:
    """The keys of one run, all under ``unspoken/<run>/``.

    Raises:
        ValueError: a run's name or a robot's id could not be one chunk of a key.
    """

    run: str

    def __post_init__(self) -> None:
        """Refuse a run's name that would change the meaning of a key."""
        _NAME.validate_python(self.run)

    def pose(self, robot: str) -> str:
        """What this robot's sensors see: world to robot."""
        return self._of("pose", robot)

    def command(self, robot: str) -> str:
        """What this robot wants to do next: robot to world."""
        return self._of("command", robot)

    def alive(self, robot: str) -> str:
        """This robot's liveliness token."""
        return self._of("alive", robot)

    def mind(self, robot: str) -> str:
        """What this robot thinks: robot to bench, never to a robot."""
        return self._of("mind", robot)

    @property
    def scene(self) -> str:
        """What everybody may know: a queryable of the world, for the bench."""
        return f"unspoken/{self.run}/scene"

    def scene_for(self, robot: str) -> str:
        """The same for this robot, which says in its question what version of the protocol it speaks."""
        return self._of("scene", robot)

    @property
    def everyones_scene(self) -> str:
        """The world's answer to whoever asks under a name that no robot of its scenario has."""
        return f"unspoken/{self.run}/scene/*"

    @property
    def truth(self) -> str:
        """True states and verdicts: world to bench."""
        return f"unspoken/{self.run}/truth"

    @property
    def everyone_alive(self) -> str:
        """The world's subscription to all liveliness tokens."""
        return f"unspoken/{self.run}/alive/*"

    @property
    def everything(self) -> str:
        """The bench's subscription."""
        return f"unspoken/{self.run}/**"

    def robot_of(self, key: str) -> str:
        """The robot named by a pose, command, alive or mind key, or by its own scene key."""
        return key.rpartition("/")[2]

    def kind_of(self, key: str) -> str:
        """The kind of a key of this run: pose, command, alive, mind, scene or truth."""
        return key.removeprefix(f"unspoken/{self.run}/").partition("/")[0]

    def _of(self, kind: str, robot: str) -> str:
        return f"unspoken/{self.run}/{kind}/{_NAME.validate_python(robot)}"
