"""A recorded run by what the world and each robot had before them, and how it differs from its repetition."""

import json
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal, TypeVar

from chassis.files import Record
from chassis.refusal import Refusal
from fleet.record.experiment import RunFacts
from fleet.record.recording import KINDS, Recording, read_recording
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, Observation, PublicScene, Truth
from protocol.scenario import Scenario, load_scenario

RECORDING_NAME = "run.mcap"
LONGEST_TOLD = 300
"""More characters of a value are not told."""
_NOTHING: Any = object()

Part = Literal["key", "scene", "observation", "mind", "command", "truth"]
"""What differs."""
Kind = TypeVar("Kind", bound=Message)
Stepped = TypeVar("Stepped", Observation, Command)


class Difference(Record):
    """One place of a recording and what stands there."""

    part: Part
    robot: str | None = None
    """Whose it is; None where it is the world's."""
    step: int | None = None
    field: str = ""
    """Such as ``robots.2.x_m``; empty for a whole message."""
    recorded: str | None
    """In the recording: a value as JSON, or words; None for nothing."""
    repeated: str | None
    """In the repetition."""

    def __str__(self) -> str:
        """One line for people."""
        whose = [f"robot {self.robot}"] if self.robot is not None else []
        when = [f"step {self.step}"] if self.step is not None else []
        what = f"{self.part} {self.field}".strip()
        recorded, repeated = (
            value if value is not None else "nothing" for value in (self.recorded, self.repeated)
        )
        return f"{', '.join([*whose, *when, what])}: recorded {recorded}, repeated {repeated}"


def compared(
    part: Part,
    recorded: Message,
    repeated: Message,
    *,
    robot: str | None = None,
    without: frozenset[str] = frozenset(),
) -> list[Difference]:
    """The first difference of two messages if there is one, bit for bit and in the order of their fields.

    Fields in ``without`` do not count, whether these messages have them or not.
    """
    one, other = (message.model_dump(mode="json", exclude=set(without)) for message in (recorded, repeated))
    for field, *values in _differences(one, other):
        was, is_now = map(_told, values)
        step = getattr(recorded, "step", None)
        return [Difference(part=part, robot=robot, step=step, field=field, recorded=was, repeated=is_now)]
    return []


def _differences(recorded: Any, repeated: Any, *field: str) -> Iterator[tuple[str, Any, Any]]:
    """Where two JSON values are not the same, and what stands there in both."""
    if isinstance(recorded, dict) and isinstance(repeated, dict):
        for name in [*recorded, *(name for name in repeated if name not in recorded)]:
            yield from _differences(recorded.get(name, _NOTHING), repeated.get(name, _NOTHING), *field, name)
        if list(recorded) != list(repeated):  # an order could carry something too
            yield ".".join(field), list(recorded), list(repeated)
    elif isinstance(recorded, list) and isinstance(repeated, list):
        for index, values in enumerate(zip_longest(recorded, repeated, fillvalue=_NOTHING)):
            yield from _differences(*values, *field, str(index))
    # Their texts tell 0.0 from -0.0, and all other numbers from each other.
    elif _told(recorded) != _told(repeated):
        yield ".".join(field), recorded, repeated


def _told(value: Any) -> str | None:
    if value is _NOTHING:
        return None
    text = json.dumps(value)
    return text if len(text) <= LONGEST_TOLD else f"{text[:LONGEST_TOLD]}…"


@dataclass(frozen=True)
class RecordedRun:
    """A recording, read key by key: what is asked for is read, and nothing else."""

    recording: Recording
    scenario: Scenario
    """As attached to the recording."""

    @property
    def facts(self) -> RunFacts:
        """What the run was."""
        return self.recording.facts

    @property
    def keys(self) -> Keys:
        """Of the run."""
        return Keys(self.facts.run)

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids, in the order of the scenario."""
        return tuple(robot.id for robot in self.scenario.robots)

    def scenes(self) -> list[PublicScene]:
        """What the world said of itself: once, unless something is wrong."""
        return list(self._on(self.keys.scene, PublicScene))

    def truths(self) -> list[Truth]:
        """Of all steps, in the order of recording."""
        return list(self._on(self.keys.truth, Truth))

    def observations(self, robot: str) -> dict[int, list[Observation]]:
        """What was put for this robot, by step."""
        return by_step(self._on(self.keys.pose(robot), Observation))

    def commands(self, robot: str) -> dict[int, list[Command]]:
        """What came from this robot, by step."""
        return by_step(self._on(self.keys.command(robot), Command))

    def minds(self, robot: str) -> list[Mind]:
        """What this robot thought, decision by decision."""
        return list(self._on(self.keys.mind(robot), Mind))

    def readable_by(self, robot: str) -> tuple[str, str]:
        """The keys that a robot reads; the router's policy (``protocol.policy``) lets it read no others."""
        return (self.keys.pose(robot), self.keys.scene)

    def strays(self) -> list[Difference]:
        """Keys and kinds of messages that have no place in this run."""
        keys = self.keys
        places = {(keys.scene, KINDS["scene"]), (keys.truth, KINDS["truth"])}
        for robot in self.robots:
            named = {"pose": keys.pose(robot), "command": keys.command(robot), "mind": keys.mind(robot)}
            places |= {(key, KINDS[kind]) for kind, key in named.items()}
        known = {(key, kind.__name__) for key, kind in places}
        return [
            Difference(part="key", field=key, recorded=f"messages of the kind {kind}", repeated=None)
            for key, kind in sorted(self.recording.channels() - known)
        ]

    def scene_differences(self) -> list[Difference]:
        """In what the recorded scene is not the one that the scenario gives for such a run.

        That one holds goals in a run with exchanged goals only.
        """
        scenes = self.scenes()
        if len(scenes) != 1:
            return [Difference(part="scene", recorded=f"{len(scenes)} scenes", repeated="1 scene")]
        [scene] = scenes
        public = self.scenario.scene(with_goals=self.facts.goals_are_exchanged)
        return compared("scene", scene, PublicScene(epoch=scene.epoch, scene=public))

    def _on(self, key: str, kind: type[Kind]) -> Iterator[Kind]:
        return (message for message in self.recording.on(key) if isinstance(message, kind))


def open_run(path: Path) -> RecordedRun:
    """Open the recording of a run: the file, or the directory that ``unspoken run`` has left.

    Raises:
        Refusal: there is none, it cannot be read, faults befell the run, its world was started again,
            or its scenario is wrong.
    """
    recording = read_recording(path / RECORDING_NAME if path.is_dir() else path)
    if number := recording.facts.faults:
        faults = "a fault was part" if number == 1 else f"{number} faults were part"
        raise Refusal(
            f"{recording.path}: {faults} of this run, so its robots may not have decided on what is "
            "recorded; only runs without faults can be repeated"
        )
    try:
        scenario = load_scenario(recording.path, recording.scenario_text)
    except Refusal as error:
        raise Refusal(f"the scenario attached to the recording cannot be used: {error}") from None
    run = RecordedRun(recording, scenario)
    if len({scene.epoch for scene in run.scenes()}) > 1:
        raise Refusal(
            f"{recording.path}: the world was started again in this run, at a step that nobody can tell "
            "exactly; only runs of a single epoch can be repeated"
        )
    return run


def by_step(messages: Iterable[Stepped]) -> dict[int, list[Stepped]]:
    """Messages by their step, each step's in their order."""
    sorted_out: defaultdict[int, list[Stepped]] = defaultdict(list)
    for message in messages:
        sorted_out[message.step].append(message)
    return dict(sorted_out)


def too_many(
    part: Part, robot: str, messages: Mapping[int, Sequence[Message]], expected: Container[int]
) -> list[Difference]:
    """What is recorded of steps of which nothing is expected, and more than one message of the others."""
    return [
        Difference(part=part, robot=robot, step=step, recorded=surplus.model_dump_json(), repeated=None)
        for step, several in messages.items()
        for surplus in several[1 if step in expected else 0 :]
    ]
