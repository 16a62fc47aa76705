"""Recordings: what is written can be read, by this program and by others, whatever happens meanwhile."""

import json
import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from chassis.refusal import Refusal
from fleet.record.recording import CHUNK_BYTES, ENDING, Recorder, RecordingError, read_recording
from fleet.run.experiment import RunFacts
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, Observation, PublicScene, State, Truth

KEYS = Keys("test")
SCENARIO_TEXT = "# a scenario – with a dash\nname: two\n"
DISK_FAULTS = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture
def messages(make_truth: Any, make_mind: Any, make_scenario: Any) -> list[tuple[str, Message]]:
    """One message of every kind, with every optional field filled in one of them."""
    state = State(x_m=0.1, y_m=-0.2, heading_rad=3.0, speed_mps=1e-17)
    return [
        (KEYS.scene, PublicScene(epoch=7, scene=make_scenario(2).scene(with_goals=True))),
        (KEYS.pose("1"), Observation(epoch=7, step=4, time_s=0.4, robots={"1": state, "2": state})),
        (
            KEYS.command("1"),
            Command(epoch=7, robot="1", step=4, turn_rate_radps=0.05, acceleration_mps2=-0.7),
        ),
        (  # beyond what the format can count
            KEYS.command("1"),
            Command(epoch=7, robot="1", step=2**53, turn_rate_radps=0.0, acceleration_mps2=0.0),
        ),
        (KEYS.mind("1"), make_mind("1", 4, {"2": (1.0, 2.0)}, {"plan": 1.5}, plan=[(0.0, 0.0), (0.1, 0.0)])),
        (KEYS.truth, make_truth(4, {"1": {}, "2": {}}, minimum_distance_m=None)),
        (
            KEYS.truth,
            make_truth(5, {"1": {"arrived_s": 0.5}, "2": {}}, collisions=(("1", "2"),), verdict="collision"),
        ),
    ]


def write(path: Path, facts: RunFacts, messages: list[tuple[str, Message]]) -> None:
    with Recorder(path, facts, SCENARIO_TEXT) as recorder:
        for index, (key, message) in enumerate(messages):
            recorder.record(key, message, received_ns=1_000 + index)


def raw(path: Path) -> list[tuple[Any, Any, Any]]:
    """Schema, channel and message records as any MCAP reader sees them."""
    with path.open("rb") as file:
        return list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))


def test_everything_is_read_back_as_it_was_recorded(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    recording = read_recording(path)
    assert recording.facts == facts
    assert recording.scenario_text == SCENARIO_TEXT
    assert list(recording) == messages
    assert list(recording) == messages, "a recording can be read more than once"


coordinates = st.floats(-1e6, 1e6)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(numbers=st.tuples(coordinates, coordinates, coordinates, coordinates), time_s=st.floats(0, 1e9))
def test_floats_come_back_exactly(
    path: Path, facts: RunFacts, numbers: tuple[float, ...], time_s: float
) -> None:
    names = ("x_m", "y_m", "heading_rad", "speed_mps")
    state = State(**dict(zip(names, numbers, strict=True)))
    write(path, facts, [(KEYS.pose("1"), Observation(epoch=7, step=0, time_s=time_s, robots={"1": state}))])
    [(_, read)] = read_recording(path)
    assert isinstance(read, Observation)
    exact = [number.hex() for number in (*read.robots["1"].as_tuple(), read.time_s)]
    assert exact == [number.hex() for number in (*numbers, time_s)]


def test_another_reader_finds_topics_times_and_steps(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    records = raw(path)
    assert [channel.topic for _, channel, _ in records] == [key for key, _ in messages]
    assert {channel.message_encoding for _, channel, _ in records} == {"json"}
    assert [record.log_time for *_, record in records] == [1000 + i for i in range(len(messages))]
    assert [record.publish_time for *_, record in records] == [record.log_time for *_, record in records]
    assert [record.sequence for *_, record in records] == [0, 4, 4, 0, 4, 4, 5]
    with path.open("rb") as file:
        reader = make_reader(file)
        [attachment] = reader.iter_attachments()
        [metadata] = reader.iter_metadata()
        summary = reader.get_summary()
    assert (attachment.name, attachment.data.decode()) == ("scenario.yaml", SCENARIO_TEXT)
    assert metadata.metadata["scenario"] == "8a"
    assert metadata.metadata["seed"] == "3"
    assert summary is not None, "a finished recording has an index"
    assert summary.chunk_indexes


def test_messages_satisfy_their_recorded_schema_and_spoilt_ones_do_not(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    for schema, _, record in raw(path):
        assert schema.encoding == "jsonschema"
        validator = jsonschema.Draft202012Validator(json.loads(schema.data))
        content = json.loads(record.data)
        validator.validate(content)
        assert not validator.is_valid(content | {"schema_version": 2})
        assert not validator.is_valid(content | {"surprise": 1})
    # The last is the truth: a fault deep inside, where only the whole schema looks.
    content["robots"]["2"]["state"]["x_m"] = "far away"
    assert not validator.is_valid(content)


def test_foxglove_can_read_the_recorded_schemas(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    fields = {schema.name: foxglove_fields(json.loads(schema.data)) for schema, *_ in raw(path)}
    assert set(fields) == {"PublicScene", "Observation", "Command", "Mind", "Truth"}
    assert {"step", "time_s", "robots"} <= fields["Truth"]
    assert {"timings_ms.plan", "failed"} <= fields["Mind"]
    assert "scene.horizons.prediction_steps" in fields["PublicScene"]


def foxglove_fields(schema: dict[str, Any]) -> set[str]:
    """The fields that Foxglove lists, by the rules of its open source reader (parseJsonSchema.ts).

    It looks only at ``type``, ``properties`` and ``items``; any other field makes it refuse the topic.
    """
    assert schema["type"] == "object"
    scalars = {"boolean", "string", "number", "integer"}
    found = set()
    for name, field in schema["properties"].items():
        found.add(name)
        nested = field["items"] if field["type"] == "array" else field
        assert nested["type"] in scalars | {"object"}, name
        if nested["type"] == "object":
            found |= {f"{name}.{inner}" for inner in foxglove_fields(nested)}
    return found


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_a_run_that_breaks_off_leaves_a_whole_recording(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]], error: type[BaseException]
) -> None:
    def run() -> None:
        with Recorder(path, facts, SCENARIO_TEXT) as recorder:
            for key, message in messages:
                recorder.record(key, message, 0)
            raise error

    with pytest.raises(error):
        run()
    assert list(read_recording(path)) == messages


def test_a_recording_can_be_read_while_it_is_written(
    path: Path, tmp_path: Path, facts: RunFacts, make_mind: Any
) -> None:
    """So it can after its process was killed: the file is then what a copy is now."""
    minds = long_minds(make_mind, 60)
    copy = tmp_path / "copy.mcap"
    with Recorder(path, facts, SCENARIO_TEXT) as recorder:
        shutil.copy(path, copy)
        assert list(read_recording(copy)) == []
        for step, (key, mind) in enumerate(minds):
            recorder.record(key, mind, step)
        shutil.copy(path, copy)
    read = list(read_recording(copy))
    assert read == minds[: len(read)]
    assert size_of(minds[len(read) :]) <= CHUNK_BYTES


@DISK_FAULTS
def test_a_full_disk_is_one_clear_error(facts: RunFacts) -> None:
    with pytest.raises(Refusal, match=r"/dev/full: .*No space left on device"):
        write(Path("/dev/full"), facts, [])


def test_what_was_recorded_before_the_disk_was_full_is_kept(
    path: Path, facts: RunFacts, make_mind: Any
) -> None:
    """Wherever the limit falls: within a chunk, at its border, or within the index at the end."""
    minds = long_minds(make_mind, 60)
    write(path, facts, minds)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    # Where each chunk with its index ends, and how many messages (at 1000 ns, 1001 ns, …) the file has then.
    chunks = [
        (
            chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length,
            chunk.message_end_time - 999,
        )
        for chunk in summary.chunk_indexes
    ]
    assert len(chunks) > 3
    whole_bytes = path.stat().st_size
    step_bytes = whole_bytes // 40
    for limit in [*range(step_bytes, whole_bytes, step_bytes), chunks[1][0] + len(ENDING), whole_bytes - 1]:
        path.unlink()
        with file_size_limit(limit), pytest.raises(Refusal, match="before can be read"):
            write(path, facts, minds)
        fitting = max((count for end, count in chunks if end + len(ENDING) <= limit), default=0)
        assert list(read_recording(path)) == minds[:fitting]


def test_after_a_failure_no_more_is_recorded(path: Path, facts: RunFacts, make_mind: Any) -> None:
    minds = long_minds(make_mind, 60)
    accepted: list[tuple[str, Message]] = []

    def record_all(recorder: Recorder) -> None:
        for key, mind in minds:
            recorder.record(key, mind, 0)
            accepted.append((key, mind))

    with Recorder(path, facts, SCENARIO_TEXT) as recorder:
        with file_size_limit(30_000), pytest.raises(Refusal, match="File too large"):
            record_all(recorder)
        with pytest.raises(Refusal, match="closed"):
            recorder.record(*minds[0], 0)
    read = list(read_recording(path))
    assert 0 < len(read) < len(minds)
    assert read == accepted[: len(read)]
    assert size_of(accepted[len(read) :]) <= CHUNK_BYTES


@contextmanager
def file_size_limit(limit: int) -> Iterator[None]:
    """The kernel refuses every byte of a file beyond the limit, with a real OSError."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def long_minds(make_mind: Any, count: int) -> list[tuple[str, Message]]:
    """Messages of some kB that hardly compress: several chunks of them."""
    return [
        (
            KEYS.mind("1"),
            make_mind("1", step, plan=[(1.0 / (k + step), 1.0 / (k + 2)) for k in range(1, 150)]),
        )
        for step in range(count)
    ]


def size_of(messages: list[tuple[str, Message]]) -> int:
    return sum(len(message.model_dump_json()) for _, message in messages)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, facts: RunFacts) -> None:
    with pytest.raises(Refusal, match=r"missing/run\.mcap: .*No such file or directory"):
        write(tmp_path / "missing" / "run.mcap", facts, [])


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nowhere\.mcap: cannot be read: No such file"):
        read_recording(tmp_path / "nowhere.mcap")


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"step,x,y\n0,1,2\n" * 10])
def test_another_file_is_not_taken_for_a_recording(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"run\.mcap: not an MCAP file"):
        read_recording(path)


def test_an_mcap_file_of_another_program_is_named_as_such(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(RecordingError, match="not the recording of a run"):
        read_recording(path)


def test_a_message_of_an_unknown_kind_is_named(path: Path, facts: RunFacts) -> None:
    class Gossip(Message):
        step: int

    write(path, facts, [("unspoken/test/gossip", Gossip(epoch=1, step=0))])
    with pytest.raises(RecordingError, match=r"unknown kind 'Gossip' on unspoken/test/gossip"):
        list(read_recording(path))


def test_a_recording_that_was_cut_off_is_named_as_such(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    content = path.read_bytes()
    for length in range(8, len(content), 97):
        path.write_bytes(content[:length])
        with pytest.raises(RecordingError, match="cut off"):
            read_recording(path)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_never_raises_anything_but_the_one_error(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]], data: st.DataObject
) -> None:
    write(path, facts, messages)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    # Any other exception fails the test; damage to an index or a topic need not be noticed.
    with suppress(Refusal):
        kinds = {type(message) for _, message in read_recording(path)}
        assert kinds <= {PublicScene, Observation, Command, Mind, Truth}


def test_damaged_messages_are_never_taken_for_good_ones(
    path: Path, facts: RunFacts, messages: list[tuple[str, Message]]
) -> None:
    write(path, facts, messages)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    [chunk] = summary.chunk_indexes
    content = path.read_bytes()
    first_byte = chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size
    places = range(first_byte, first_byte + chunk.compressed_size, 5)
    noticed = 0
    for place in places:
        path.write_bytes(content[:place] + bytes([content[place] ^ 0x01]) + content[place + 1 :])
        # A few bits mean nothing to the decompressor; with one of them turned the messages are the same.
        try:
            assert list(read_recording(path)) == messages
        except RecordingError as error:
            noticed += "damaged" in str(error)
    assert noticed > 0.9 * len(places)
