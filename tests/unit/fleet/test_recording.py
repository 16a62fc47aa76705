"""Recordings: what is written can be read, by this program and by others, whatever happens meanwhile."""

import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from pydantic import create_model
from run_helpers import FACTS, KEYS, command, file_size_limit, mind, ring, truth

from chassis.refusal import Refusal
from fleet.record.recording import CHUNK_BYTES, ENDING, KINDS, Recorder, read_recording
from protocol.messages import Command, Message, Observation, PublicScene, State

SCENARIO_TEXT = "# a scenario – with a dash\nname: two\n"
DISK_FAULTS = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
STATE = State(x_m=0.1, y_m=-0.2, heading_rad=3.0, speed_mps=1e-17)
MESSAGES = [
    (KEYS.scene, PublicScene(epoch=7, scene=ring(2).scene(with_goals=True))),
    (KEYS.pose("1"), Observation(epoch=7, step=4, time_s=0.4, robots={"1": STATE, "2": STATE})),
    (KEYS.command("1"), command("1", 4)),
    (KEYS.command("1"), command("1", 2**53)),  # beyond what the format can count
    (KEYS.mind("1"), mind("1", 4, {"2": (1.0, 2.0)}, {"plan": 1.5}, plan=[(0.0, 0.0), (0.1, 0.0)])),
    (KEYS.truth, truth(4, {"1": {}, "2": {}}, minimum_distance_m=None)),
    (
        KEYS.truth,
        truth(5, {"1": {"arrived_s": 0.5}, "2": {}}, collisions=(("1", "2"),), verdict="collision"),
    ),
]
"""One message of every kind, with every optional field filled in one of them."""
MINDS = [
    (KEYS.mind("1"), mind("1", step, plan=[(1.0 / (k + step), 1.0 / (k + 2)) for k in range(1, 150)]))
    for step in range(60)
]
"""Messages of some kB that hardly compress: several chunks of them."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def write(path: Path, messages: list[tuple[str, Message]] = MESSAGES) -> None:
    with Recorder(path, FACTS, SCENARIO_TEXT) as recorder:
        for index, (key, message) in enumerate(messages):
            recorder.record(key, message, received_ns=1_000 + index)


def size_of(messages: list[tuple[str, Message]]) -> int:
    return sum(len(message.model_dump_json()) for _, message in messages)


def raw(path: Path) -> list[tuple[Any, Any, Any]]:
    """Schema, channel and message records as any MCAP reader sees them."""
    with path.open("rb") as file:
        return list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))


def chunks_of(path: Path) -> list[Any]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None, "a finished recording has an index"
    return summary.chunk_indexes


def test_everything_is_read_back_as_it_was_recorded(path: Path) -> None:
    write(path)
    recording = read_recording(path)
    assert recording.facts == FACTS
    assert recording.scenario_text == SCENARIO_TEXT
    assert list(recording) == MESSAGES
    assert list(recording) == MESSAGES, "a recording can be read more than once"


coordinates = st.floats(-1e6, 1e6)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(numbers=st.tuples(coordinates, coordinates, coordinates, coordinates), time_s=st.floats(0, 1e9))
def test_floats_come_back_exactly(path: Path, numbers: tuple[float, ...], time_s: float) -> None:
    state = State(**dict(zip(State.model_fields, numbers, strict=True)))
    write(path, [(KEYS.pose("1"), Observation(epoch=7, step=0, time_s=time_s, robots={"1": state}))])
    [(_, read)] = read_recording(path)
    assert isinstance(read, Observation)
    exact = [number.hex() for number in (*read.robots["1"].as_tuple(), read.time_s)]
    assert exact == [number.hex() for number in (*numbers, time_s)]


def test_another_reader_finds_topics_times_and_steps(path: Path) -> None:
    write(path)
    records = raw(path)
    assert [channel.topic for _, channel, _ in records] == [key for key, _ in MESSAGES]
    assert {channel.message_encoding for _, channel, _ in records} == {"json"}
    times_ns = [1000 + i for i in range(len(MESSAGES))]
    assert [(record.log_time, record.publish_time) for *_, record in records] == [(t, t) for t in times_ns]
    assert [record.sequence for *_, record in records] == [0, 4, 4, 0, 4, 4, 5]
    with path.open("rb") as file:
        reader = make_reader(file)
        [attachment] = reader.iter_attachments()
        [metadata] = reader.iter_metadata()
    assert (attachment.name, attachment.data.decode()) == ("scenario.yaml", SCENARIO_TEXT)
    assert (metadata.metadata["scenario"], metadata.metadata["seed"]) == ("8a", "3")
    assert chunks_of(path)


def test_messages_satisfy_their_recorded_schema_and_spoilt_ones_do_not(path: Path) -> None:
    write(path)
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


def test_foxglove_can_read_the_recorded_schemas(path: Path) -> None:
    write(path)
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
def test_a_run_that_breaks_off_leaves_a_whole_recording(path: Path, error: type[BaseException]) -> None:
    def run() -> None:
        with Recorder(path, FACTS, SCENARIO_TEXT) as recorder:
            for key, message in MESSAGES:
                recorder.record(key, message, 0)
            raise error

    with pytest.raises(error):
        run()
    assert list(read_recording(path)) == MESSAGES


def test_a_recording_can_be_read_while_it_is_written(path: Path, tmp_path: Path) -> None:
    """So it can after its process was killed: the file is then what a copy is now."""
    copy = tmp_path / "copy.mcap"
    with Recorder(path, FACTS, SCENARIO_TEXT) as recorder:
        shutil.copy(path, copy)
        assert list(read_recording(copy)) == []
        for step, (key, message) in enumerate(MINDS):
            recorder.record(key, message, step)
        shutil.copy(path, copy)
    read = list(read_recording(copy))
    assert read == MINDS[: len(read)]
    assert size_of(MINDS[len(read) :]) <= CHUNK_BYTES


@DISK_FAULTS
def test_a_full_disk_is_one_clear_error() -> None:
    with pytest.raises(Refusal, match=r"/dev/full: .*No space left on device"):
        write(Path("/dev/full"), [])


def test_what_was_recorded_before_the_disk_was_full_is_kept(path: Path) -> None:
    """Wherever the limit falls: within a chunk, at its border, or within the index at the end."""
    write(path, MINDS)
    # Where each chunk with its index ends, and how many messages (at 1000 ns, 1001 ns, …) the file has then.
    chunks = [
        (each.chunk_start_offset + each.chunk_length + each.message_index_length, each.message_end_time - 999)
        for each in chunks_of(path)
    ]
    assert len(chunks) > 3
    whole_bytes = path.stat().st_size
    step_bytes = whole_bytes // 20
    for limit in [*range(step_bytes, whole_bytes, step_bytes), chunks[1][0] + len(ENDING), whole_bytes - 1]:
        path.unlink()
        with file_size_limit(limit), pytest.raises(Refusal, match="before can be read"):
            write(path, MINDS)
        fitting = max((count for end, count in chunks if end + len(ENDING) <= limit), default=0)
        assert list(read_recording(path)) == MINDS[:fitting]


def test_after_a_failure_no_more_is_recorded(path: Path) -> None:
    def record_all(recorder: Recorder) -> None:
        for key, message in MINDS:
            recorder.record(key, message, 0)

    with Recorder(path, FACTS, SCENARIO_TEXT) as recorder:
        with file_size_limit(30_000), pytest.raises(Refusal, match="File too large"):
            record_all(recorder)
        with pytest.raises(Refusal, match="closed"):
            recorder.record(*MINDS[0], 0)
    read = list(read_recording(path))
    assert 0 < len(read) < len(MINDS)
    assert read == MINDS[: len(read)]


def test_a_place_that_cannot_be_written_or_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match=r"missing/run\.mcap: .*No such file or directory"):
        write(tmp_path / "missing" / "run.mcap", [])
    with pytest.raises(Refusal, match=r"nowhere\.mcap: cannot be read: No such file"):
        read_recording(tmp_path / "nowhere.mcap")


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"step,x,y\n0,1,2\n" * 10])
def test_another_file_is_not_taken_for_a_recording(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(Refusal, match=r"run\.mcap: not an MCAP file"):
        read_recording(path)


def test_an_mcap_file_of_another_program_is_named_as_such(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(Refusal, match="not the recording of a run"):
        read_recording(path)


def test_a_message_of_an_unknown_kind_is_named(path: Path) -> None:
    class Gossip(Message):
        step: int

    write(path, [("unspoken/test/gossip", Gossip(epoch=1, step=0))])
    with pytest.raises(Refusal, match=r"unknown kind 'Gossip' on unspoken/test/gossip"):
        list(read_recording(path))


def test_what_an_earlier_version_said_is_named_with_the_remedy(path: Path) -> None:
    """A command once held the input planned for the next step, too."""
    earlier = create_model("Command", __base__=Command, then=(tuple[float, float] | None, None))
    write(path, [(KEYS.command("1"), earlier(**command("1", 4).model_dump()))])
    told = r"does not write: Command\.then: Extra inputs .* read it with the version that wrote it"
    with pytest.raises(Refusal, match=told):
        list(read_recording(path))


def test_a_recording_that_was_cut_off_is_named_as_such(path: Path) -> None:
    write(path)
    content = path.read_bytes()
    for length in range(8, len(content), 97):
        path.write_bytes(content[:length])
        with pytest.raises(Refusal, match="cut off"):
            read_recording(path)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_never_raises_anything_but_the_one_error(path: Path, data: st.DataObject) -> None:
    write(path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    # Any other exception fails the test; damage to an index or a topic need not be noticed.
    with suppress(Refusal):
        assert {type(message) for _, message in read_recording(path)} <= set(KINDS.values())


def test_damaged_messages_are_never_taken_for_good_ones(path: Path) -> None:
    write(path)
    [chunk] = chunks_of(path)
    content = path.read_bytes()
    first_byte = chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size
    places = range(first_byte, first_byte + chunk.compressed_size, 11)
    noticed = 0
    for place in places:
        path.write_bytes(content[:place] + bytes([content[place] ^ 0x01]) + content[place + 1 :])
        # A few bits mean nothing to the decompressor; with one of them turned the messages are the same.
        try:
            assert list(read_recording(path)) == MESSAGES
        except Refusal as error:
            noticed += "damaged" in str(error)
    assert noticed > 0.9 * len(places)
