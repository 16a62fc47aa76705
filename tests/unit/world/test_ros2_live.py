"""A world of real robots as a run steps it, over scripted buses and a scripted clock."""

import pytest
import structlog
from ros2_helpers import odometry_bytes, settings
from structlog.testing import capture_logs
from world_helpers import EPOCH, NIMBLE, command

from world.ros2.cdr import STOP
from world.ros2.live import MOST_WAITING, LiveWorld, OdometryInbox

QUICK = {"limits": NIMBLE.model_dump()}


class Track:
    """A live world with everything around it scripted; `twists` holds what robots were told, in order."""

    def __init__(self, count=2, **rules):
        self.now_s = 50.0
        self.twists = []
        bridge, log = settings(count, robot=QUICK, **rules), structlog.get_logger()
        self.odometry = OdometryInbox([robot.id for robot in bridge.robots], self.now)
        self.world = LiveWorld(bridge, self.odometry, self.put, log, epoch=EPOCH, now_s=self.now)

    def now(self):
        return self.now_s

    def put(self, robot, twist):
        self.twists.append((robot, twist))

    def told(self):
        """What robots were told since the last time."""
        told, self.twists = self.twists, []
        return told

    def sends(self, robot, *values, **fields):
        payload = odometry_bytes(*values, stamp_ns=round(self.now_s * 1e9), **fields)
        self.odometry.store(robot, payload)

    def next(self, commands=None):
        self.now_s += 0.1
        self.sends("1")
        self.world.advance(commands or {})


def test_robots_are_told_to_brake_before_a_command_and_what_it_says_as_soon_as_it_comes():
    track = Track(1)
    track.sends("1", 0.0, 0.0, 0.0, 1.0)
    track.world.begin()
    [(_, braking)] = track.told()
    assert braking.speed_mps == pytest.approx(0.7)
    answer = command("1", track.world.step, 1.0, 0.2)
    track.world.heed("1", answer)
    [(robot, driving)] = track.told()
    assert (robot, driving) == ("1", (pytest.approx(1.1), 0.2))


def test_loss_and_return_of_odometry_are_told_once_each():
    track = Track(3, stale_s=0.15)
    track.sends("1")
    track.sends("2", 3.0)
    with capture_logs() as logs:
        track.world.begin()
        for _ in range(5):
            track.next()
        assert dict(track.told())["2"] == STOP
        track.sends("2", 3.0)
        track.next()
    [never] = [each["robots"] for each in logs if each["event"] == "no odometry yet: not driven and not seen"]
    assert never == "3"
    about = [(each["event"], each["step"]) for each in logs if each.get("robot") == "2"]
    assert about == [("odometry found", 1), ("odometry lost: the robot is stopped", 3), ("odometry found", 7)]
    track.told()
    track.world.stop()
    assert track.told() == [("1", STOP), ("2", STOP), ("3", STOP)]


def test_what_is_refused_is_counted_by_reason_and_each_reason_told_once():
    track = Track()
    track.sends("1")
    good = odometry_bytes(1.0)
    for payload in (b"", bytes(5000), good[:-1], *[b"\xff" * 40] * 3):
        track.odometry.store("2", payload)
    track.sends("2", frame_id="map")
    track.sends("2", 1e9)
    track.sends("2", 3.0)
    track.sends("2", 4.0)
    with capture_logs() as logs:
        track.world.begin()
    assert track.world.refused_odometry == {
        "2": {
            "not an Odometry message": 6,
            "in another frame": 1,
            "out of range": 1,
            "not newer than the last one": 1,
        }
    }
    refusals = [each for each in logs if each["event"] == "odometry refused"]
    assert len(refusals) == 4
    assert track.world.present == ("1", "2")  # what is good counts beside what is not


def test_a_flood_of_odometry_is_bounded_and_its_newest_counts():
    track = Track()
    for index in range(10 * MOST_WAITING):
        track.now_s += 1e-4
        track.sends("1", float(index))
    track.sends("2")
    track.world.begin()
    assert track.world.observations()["2"].robots["1"].x_m == 10 * MOST_WAITING - 1
    assert track.world.refused_odometry == {}
