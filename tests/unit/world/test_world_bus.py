"""The world's declarations on a real session, inside the test's own process."""

import threading

import pytest
import zenoh
from world_helpers import EPOCH, KEYS, PATIENCE_S, lanes

from protocol.codec import decode
from protocol.messages import Observation, PublicScene
from protocol.scenario import Sensing
from protocol.session import client_session, world_session
from world.bus import Bus, Inbox
from world.world import World


@pytest.fixture
def sessions(endpoint):
    """A world's session and a robot's, connected."""
    with (
        zenoh.open(world_session(endpoint).to_zenoh()) as world,
        zenoh.open(client_session(endpoint).to_zenoh()) as robot,
    ):
        yield world, robot


def declare(session):
    scene, inbox = PublicScene(epoch=EPOCH, scene=lanes(2).scene(with_goals=False)), Inbox(["1", "2"])
    return Bus(session, KEYS, scene, ("1", "2"), inbox), inbox


def test_a_robot_that_was_there_before_the_world_listened_is_present(sessions):
    ours, theirs = sessions
    seen = threading.Event()
    watcher = ours.liveliness().declare_subscriber(KEYS.everyone_alive, lambda _: seen.set())
    token = theirs.liveliness().declare_token(KEYS.alive("1"))
    assert seen.wait(PATIENCE_S)
    watcher.undeclare()
    _, inbox = declare(ours)
    assert inbox.take(PATIENCE_S).present == {"1"}
    token.undeclare()
    arrivals = inbox.take(PATIENCE_S)
    assert (arrivals.present, arrivals.gone) == (frozenset(), {"1"})


def test_each_robot_gets_its_own_observation_only(sessions):
    ours, theirs = sessions
    got = []
    done = threading.Event()

    def keep(sample):
        got.append((str(sample.key_expr), decode(Observation, sample.payload.to_bytes())))
        if len(got) == 2:
            done.set()

    listener = theirs.declare_subscriber("unspoken/run/pose/*", keep)
    world = World(lanes(2, sensing=Sensing(position_noise_m=0.1)), seed=0, epoch=EPOCH)
    token = theirs.liveliness().declare_token(KEYS.alive("1"))
    bus, inbox = declare(ours)
    assert inbox.take(PATIENCE_S).present == {"1"}
    bus.publish_observations(world.observations())
    assert done.wait(PATIENCE_S)
    assert dict(got) == {KEYS.pose(robot): seen for robot, seen in world.observations().items()}
    listener.undeclare()
    token.undeclare()


def test_the_world_waits_until_the_last_reader_of_the_truth_has_left(sessions):
    ours, theirs = sessions
    world = World(lanes(2), seed=0, epoch=EPOCH)
    bus, _ = declare(ours)
    got = threading.Event()
    reader = theirs.declare_subscriber(KEYS.everything, lambda _: got.set())
    while not got.wait(0.05):
        bus.publish_truth(world.truth())  # until the subscription has come through
    left = threading.Event()
    waiting = threading.Thread(target=lambda: (bus.wait_for_readers(PATIENCE_S), left.set()))
    waiting.start()
    assert not left.wait(0.3)
    reader.undeclare()
    assert left.wait(PATIENCE_S)
    waiting.join()
    bus.wait_for_readers(float("inf"))  # without readers it does not wait
