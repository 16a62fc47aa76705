"""A run as a stream of bus messages, and its recording, one MCAP file, which Foxglove opens."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Self

from mcap.data_stream import RecordBuilder
from mcap.reader import McapReader, make_reader
from mcap.records import DataEnd, Footer, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, Writer
from pydantic import ValidationError

from chassis.refusal import ExitStatus, Refusal
from fleet.record.experiment import RunFacts
from protocol.messages import Command, Message, Mind, Observation, PublicScene, Truth
from protocol.messages import Refusal as Reason

KINDS: Final[dict[str, type[Message]]] = {
    "pose": Observation,
    "command": Command,
    "scene": PublicScene,
    "truth": Truth,
    "mind": Mind,
}
"""The message that each kind of key carries."""


class BusMessage(NamedTuple):
    """One message as it was on the bus."""

    key: str
    message: Message
    time_ns: int
    """Unix time of arrival for real processes; simulated time since step 0 in virtual time."""


TOO_MANY: Final = "too many at once"
"""Why minds are not recorded that come faster than the bench takes them."""


class RefusedMind(NamedTuple):
    """Minds of a robot that were not recorded."""

    robot: str
    reason: Reason | Literal["too many at once"]
    how_many: int = 1


class Restarted(NamedTuple):
    """A process of the run was started again."""

    process: str


StreamItem = BusMessage | RefusedMind | Restarted
"""What a run tells."""
JsonSchema = dict[str, Any]
_SCALARS = ("boolean", "string", "number", "integer")


def message_schema(kind: type[Message]) -> bytes:
    """The JSON schema of a kind of message, as UTF-8 JSON.

    Foxglove builds its list of fields from ``type`` and ``properties`` alone and refuses a topic whose
    properties hold a reference, an alternative (``anyOf``) or an array of arrays. So these two keywords hold
    an outline of what it does read, and the whole schema stands beside them under ``allOf``, which a
    validator applies as well. A field that is missing in the outline is still shown with the message.
    """
    whole = kind.model_json_schema()
    definitions = whole.pop("$defs", {})
    outline = _outline(whole, definitions)
    assert outline is not None, "a message is an object"
    schema = {"title": kind.__name__, **outline, "allOf": [whole], "$defs": definitions}
    return json.dumps(schema, ensure_ascii=False).encode()


def _outline(schema: JsonSchema, definitions: JsonSchema) -> JsonSchema | None:
    """As much of a schema as Foxglove can read, which of a map is that it is an object; None for nothing."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rpartition("/")[2]]
    kind = schema.get("type")
    if kind == "object":
        fields = {name: _outline(each, definitions) for name, each in schema.get("properties", {}).items()}
        return {"type": "object", "properties": {name: each for name, each in fields.items() if each}}
    if kind == "array" and schema["items"].get("type") in _SCALARS:
        return {"type": "array", "items": {"type": schema["items"]["type"]}}
    return {"type": kind} if kind in _SCALARS else None


SCENARIO_ATTACHMENT: Final = "scenario.yaml"
FACTS_METADATA: Final = "run"
CHUNK_BYTES: Final = 64 * 1024
"""Messages are compressed together up to this size, about one step of eight robots: what a crash can cost."""

_KINDS_BY_NAME = {kind.__name__: kind for kind in KINDS.values()}


def _shortest_ending() -> bytes:
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    ending: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap does not annotate it
    return ending + MCAP0_MAGIC


ENDING: Final = _shortest_ending()
"""The shortest end of an MCAP file: one without an index, which readers then do without."""


class Recorder:
    """Writes one recording; a context manager, to be used by one thread.

    Each bus key becomes a topic of the same name, with messages in JSON and their schema. The scenario
    file's text is an attachment and the run's facts are metadata. However the block is left, the file is
    closed and readable.

    After every chunk a short ending is written, which the next chunk overwrites. So the file can be read
    although the process was killed, and on a full disk there is room for an ending after the last whole
    chunk: at most the ``CHUNK_BYTES`` that did not fit are missing.

    Args:
        path: the file to write; one that exists is replaced.
        facts: what the run is.
        scenario_text: the scenario file as it was read.
        open_file: opens the file for writing.
    """

    def __init__(
        self,
        path: Path,
        facts: RunFacts,
        scenario_text: str,
        open_file: Callable[[Path], BufferedWriter] = lambda path: path.open("wb"),
    ) -> None:
        self._path = path
        self._facts = facts
        self._scenario_text = scenario_text
        self._channels: dict[tuple[str, type[Message]], int] = {}
        self._schemas: dict[type[Message], int] = {}
        self._open_file = open_file
        self._closed = False
        self._whole_bytes = 0

    def __enter__(self) -> Self:
        """Open the file and write what is known before the first message.

        Raises:
            Refusal: the file cannot be opened or written.
        """
        try:
            self._file = self._open_file(self._path)
        except OSError as error:
            raise self._refusal(f"cannot write a recording there: {error.strerror}") from error
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        with self._failing_readably():
            self._writer.start()
            # Times of zero: not known, and so that a simulation's recording depends on nothing but its run.
            text = self._scenario_text.encode()
            self._writer.add_attachment(0, 0, SCENARIO_ATTACHMENT, "application/yaml", text)
            facts = {name: str(value) for name, value in self._facts.model_dump(exclude_none=True).items()}
            self._writer.add_metadata(FACTS_METADATA, facts)
            self._settle()
        return self

    def record(self, key: str, message: Message, received_ns: int) -> None:
        """Add one message.

        Args:
            key: the Zenoh key on which it was put.
            message: what was put.
            received_ns: when, in ns since an epoch of the caller's choice; Foxglove shows it as the time of
                the message, so it should be Unix time for a run in real time, and may start at zero for a
                simulation.

        Raises:
            Refusal: the disk did not take it, or did not take something earlier.
        """
        if self._closed:
            raise self._refusal("the recording is closed; no more messages can be added")
        # MCAP counts in 32 bits, steps may in theory go further.
        sequence = getattr(message, "step", 0) % 2**32
        data = message.model_dump_json().encode()
        with self._failing_readably():
            channel = self._channel(key, type(message))
            self._writer.add_message(channel, received_ns, data, publish_time=received_ns, sequence=sequence)
            self._settle()

    def __exit__(self, *_error: object) -> None:
        """Write the rest and the index, and close the file.

        Raises:
            Refusal: the disk did not take it.
        """
        if self._closed:
            return
        with self._failing_readably():
            self._writer.flush()  # type: ignore[no-untyped-call]  # mcap does not annotate it
            self._settle()
            self._writer.finish()  # type: ignore[no-untyped-call]  # the same
            self._file.close()
        self._closed = True

    def _channel(self, key: str, kind: type[Message]) -> int:
        writer, known = self._writer, (key, kind)
        if kind not in self._schemas:
            schema = message_schema(kind)
            self._schemas[kind] = writer.register_schema(kind.__name__, SchemaEncoding.JSONSchema, schema)
        if known not in self._channels:
            self._channels[known] = writer.register_channel(key, MessageEncoding.JSON, self._schemas[kind])
        return self._channels[known]

    def _settle(self) -> None:
        """Where whole chunks were added to the file, put the ending after them."""
        self._file.flush()
        position = self._file.tell()
        if position > self._whole_bytes:
            self._file.write(ENDING)
            self._file.flush()
            self._file.seek(position)
            self._whole_bytes = position

    @contextmanager
    def _failing_readably(self) -> Iterator[None]:
        """On any failure, an interrupt too, end the file after its last whole chunk."""
        try:
            yield
        except OSError as error:
            ending = self._end_after_whole_chunks()
            raise self._refusal(f"the recording cannot go on: {error.strerror}; {ending}") from error
        except BaseException:
            self._end_after_whole_chunks()
            raise

    def _refusal(self, reason: str) -> Refusal:
        return Refusal(f"{self._path}: {reason}", ExitStatus.FAILED)

    def _end_after_whole_chunks(self) -> str:
        """Replace what is incomplete by the ending, and close the file; say how it went."""
        self._closed = True
        # Closing writes what is left in the buffer; whether that works or not, it is cut off below.
        with suppress(OSError):
            self._file.close()
        if not self._whole_bytes:
            return "nothing was recorded"
        try:
            with self._path.open("r+b") as file:
                file.seek(self._whole_bytes)
                # First the ending, in the place of the former one, which needs no further room on the disk.
                file.write(ENDING)
                file.truncate()
        except OSError as error:
            return f"nor could the file be ended properly: {error.strerror}"
        return "what was recorded before can be read"


@dataclass(frozen=True)
class Recording:
    """A recording that was read back; iterating gives (key, message) in the order of recording.

    Iterating reads the file anew, a chunk at a time, and raises Refusal where it is damaged.
    """

    path: Path
    facts: RunFacts
    scenario_text: str

    def __iter__(self) -> Iterator[tuple[str, Message]]:
        """All messages, decoded and validated; floats are exactly those that were recorded."""
        return self._messages(None)

    def on(self, key: str) -> Iterator[Message]:
        """The messages on one key, as above; no other message is decoded."""
        return (message for _, message in self._messages([key]))

    def channels(self) -> frozenset[tuple[str, str]]:
        """Each key on which there is a message, with the kind of message as the recording names it."""
        with _reading(self.path) as reader:
            return frozenset(
                (channel.topic, _kind_of(schema))
                for schema, channel, _ in reader.iter_messages(log_time_order=False)
            )

    def _messages(self, keys: list[str] | None) -> Iterator[tuple[str, Message]]:
        with _reading(self.path) as reader:
            for schema, channel, record in reader.iter_messages(topics=keys, log_time_order=False):
                name = _kind_of(schema)
                if name not in _KINDS_BY_NAME:
                    raise Refusal(
                        f"{self.path}: a message of the unknown kind {name!r} on {channel.topic}; "
                        f"expected one of {', '.join(_KINDS_BY_NAME)}: read it with the version that wrote it"
                    )
                yield channel.topic, _KINDS_BY_NAME[name].model_validate_json(record.data)


def _kind_of(schema: Schema | None) -> str:
    return schema.name if schema else "without a schema"


def read_recording(path: Path) -> Recording:
    """Open a recording of a run.

    Raises:
        Refusal: there is no such file, it is not MCAP, it was cut off, it is damaged, or it is not a
            recording of a run.
    """
    with _reading(path) as reader:
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachments = {record.name: record.data for record in reader.iter_attachments()}
        if FACTS_METADATA not in metadata or SCENARIO_ATTACHMENT not in attachments:
            raise Refusal(
                f"{path}: an MCAP file, but not the recording of a run: the metadata {FACTS_METADATA!r} and "
                f"the attachment {SCENARIO_ATTACHMENT!r} are expected in it"
            )
        facts = RunFacts.model_validate_strings(metadata[FACTS_METADATA])
        return Recording(path, facts, attachments[SCENARIO_ATTACHMENT].decode())


@contextmanager
def _reading(path: Path) -> Iterator[McapReader]:
    """A reader of a file that begins and ends as MCAP does; one kind of exception for all that is wrong."""
    try:
        with path.open("rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise Refusal(f"{path}: not an MCAP file: its first bytes are not those of one")
            file.seek(max(len(MCAP0_MAGIC), path.stat().st_size - len(MCAP0_MAGIC)))
            if file.read() != MCAP0_MAGIC:
                raise Refusal(
                    f"{path}: the file was cut off: its end is missing; "
                    "the command `mcap recover` can save the messages before the cut"
                )
            file.seek(0)
            yield make_reader(file, validate_crcs=True)
    except Refusal:
        raise
    except OSError as error:
        raise Refusal(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, (error.title, *first["loc"])))
        raise Refusal(
            f"{path}: holds what this version of the software does not write: {where}: {first['msg']}; "
            "read it with the version that wrote it"
        ) from None
    # Damaged bytes raise the reader's own errors, struct.error, ValueError, KeyError, ZstdError, MemoryError
    # and others: all of them mean the same here.
    except Exception as error:
        raise Refusal(
            f"{path}: the file is damaged: {type(error).__name__}: {error!s:.200}; "
            "the command `mcap doctor` tells more"
        ) from error
