"""Only the newest pose counts, however many wait and whatever lies between them."""

import msgpack
import pytest
import structlog
from agent_helpers import seen
from structlog.testing import capture_logs

from agent.process.inbox import Inbox
from protocol.codec import OtherVersionError, encode
from protocol.messages import Observation

HERE = {"a": (1.0, 2.0, 0.5, 0.0)}


def pose(step: int, *, epoch: int = 7) -> Observation:
    return seen(step, HERE).model_copy(update={"epoch": epoch})


@pytest.fixture
def inbox():
    return Inbox(structlog.get_logger())


def test_only_the_newest_pose_counts_and_only_if_it_is_newer_than_the_one_taken(inbox):
    for step in range(50):
        inbox.store(encode(pose(step)))
    assert inbox.has_news()
    assert inbox.has_news(), "looking takes nothing away"
    assert inbox.next() == pose(49)
    for step in (49, 3, 0):
        inbox.store(encode(pose(step)))
        assert not inbox.has_news()
    for each in (pose(51), pose(50)):
        inbox.store(encode(each))
    assert inbox.next() == pose(51)
    inbox.store(encode(pose(0, epoch=8)))
    assert inbox.next() == pose(0, epoch=8), "a new epoch is news at any step"


def test_what_is_no_pose_is_refused_and_hides_none(inbox):
    inbox.store(encode(pose(1)))
    inbox.next()
    with capture_logs() as log:
        inbox.store(b"\xc1 garbage")
        assert not inbox.has_news()
        inbox.store(encode(pose(2)))
        inbox.store(b"")
        assert inbox.next() == pose(2)
    assert [entry["event"] for entry in log] == ["refused an observation"] * 2


def of_another_version(step: int) -> bytes:
    return msgpack.packb(pose(step).model_dump(mode="python") | {"schema_version": 9})


def test_a_pose_of_another_version_is_told_once_where_there_is_no_newer_pose(inbox):
    inbox.store(of_another_version(0))
    told = inbox.next()
    assert isinstance(told, OtherVersionError)
    assert told.version == 9
    inbox.store(encode(pose(1)))
    inbox.store(of_another_version(2))
    assert inbox.next() == pose(1)
    inbox.store(of_another_version(3))
    inbox.store(encode(pose(4)))
    assert inbox.next() == pose(4)
    assert not inbox.has_news()
    inbox.close()
    assert inbox.next() is None
