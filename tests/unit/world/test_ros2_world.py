"""Real robots as a core: odometry and commands in, observations and twists out."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros2_helpers import diagonal, odometry_bytes, settings
from world_helpers import EPOCH, NIMBLE, command

from protocol.messages import Accuracy, Command
from world.ros2.cdr import STOP, Twist, decode_odometry
from world.ros2.odometry import Reading
from world.ros2.world import FIRST_STEP, OdometryWorld, gone_on
from world.vehicle import VehicleState

QUICK = {"limits": NIMBLE.model_dump()}


class Floor:
    """A core with robots that send odometry when they are told to; now is 100 s at the first step."""

    def __init__(self, count=2, robot=QUICK, **rules):
        self.core = OdometryWorld(settings(count, robot=robot, **rules), epoch=EPOCH)
        self.now_s = 100.0

    def sends(self, robot, *values, late_s=0.0, **fields):
        stamp_ns = round((self.now_s - late_s) * 1e9)
        payload = odometry_bytes(*values, stamp_ns=stamp_ns, **fields)
        self.core.take(robot, decode_odometry(payload), self.now_s)

    def all_send(self, *values):
        for index, robot in enumerate(self.core.robots):
            self.sends(robot, 0.0, 2.0 * index, 0.0, *values)

    def look(self):
        self.core.look(self.now_s)

    def step(self, commands=None, passed_s=0.1):
        self.core.advance(commands or {})
        self.now_s += passed_s

    def answer(self, robot, acceleration, turn_rate=0.0, **more):
        return command(robot, self.core.step, acceleration, turn_rate, **more)


def states(observation):
    return {robot: state.as_tuple() for robot, state in observation.robots.items()}


def test_everybody_is_told_where_everybody_is():
    floor = Floor(3)
    floor.all_send(1.5)
    floor.look()
    observations = floor.core.observations()
    assert list(observations) == ["1", "2", "3"]
    for observation in observations.values():
        # At step 0 robots take everybody to stand, and nobody has made sure of that.
        assert (observation.step, observation.time_s, observation.epoch) == (FIRST_STEP, 0.1, EPOCH)
        assert states(observation) == {str(i + 1): (0.0, pytest.approx(2.0 * i), 0.0, 1.5) for i in range(3)}
        assert observation.age_steps == 0


@given(st.floats(-3.0, 3.0), st.floats(-4.0, 4.0), st.floats(-2.0, 2.0), st.floats(0.0, 1.0))
def test_between_measurement_and_step_a_robot_goes_on_along_its_arc(heading, speed, turn, age_s):
    found = gone_on(Reading(0, VehicleState(1.0, 2.0, heading, speed), turn, Accuracy()), age_s)
    x_m, y_m, angle, pieces = 1.0, 2.0, heading, 200
    for _ in range(pieces):  # the same, in small steps
        middle = angle + turn * age_s / pieces / 2
        x_m += speed * age_s / pieces * math.cos(middle)
        y_m += speed * age_s / pieces * math.sin(middle)
        angle += turn * age_s / pieces
    assert found == pytest.approx((x_m, y_m, angle, speed), abs=1e-4)


def test_odometry_is_brought_to_the_time_of_the_step_and_further_where_it_was_held_up():
    floor = Floor()
    floor.sends("1", 0.0, 0.0, 0.0, 2.0)
    floor.now_s += 0.1
    floor.sends("1", 0.1, 0.0, 0.0, 2.0, late_s=0.05)
    floor.sends("2", 5.0, 0.0, math.pi, 1.0)
    floor.now_s += 0.01
    floor.look()
    found = states(floor.core.observations()["1"])
    assert found["1"][0] == pytest.approx(0.22)
    assert found["2"][0] == pytest.approx(4.99)


def test_stale_odometry_takes_a_robot_out_of_the_scene_and_new_odometry_brings_it_back():
    floor = Floor(3, stale_s=0.25)
    floor.all_send(1.0)
    floor.look()
    for step in range(4):
        floor.step()
        floor.sends("1", 0.0, 0.0)
        floor.sends("3", 0.0, 4.0)
        floor.look()
        there = {"1", "3"} if step >= 2 else {"1", "2", "3"}
        assert set(floor.core.present) == there
        observations = floor.core.observations()
        assert set(observations) == there
        assert all(set(each.robots) == there for each in observations.values())
        assert set(floor.core.truth().robots) == there
    assert floor.core.twist("2") == STOP
    assert floor.core.twist("2", floor.answer("2", 1.0)) == STOP
    floor.sends("2", 0.3, 2.0)
    floor.look()
    assert set(floor.core.present) == {"1", "2", "3"}
    assert floor.core.twist("2", floor.answer("2", 1.0)) == Twist(pytest.approx(0.1), 0.0)
    misses = {robot: true.deadline_misses for robot, true in floor.core.truth().robots.items()}
    assert misses == {"1": 4, "2": 3, "3": 4}, "none while it is not in the scene"


def test_a_robot_that_was_held_back_does_not_start_with_a_jump():
    floor = Floor(1, drive_lag_s=0.2)
    for _ in range(30):
        floor.sends("1", 0.0, 0.0, 0.0, 0.0)  # somebody holds it
        floor.look()
        answer = floor.answer("1", 3.0)
        assert floor.core.twist("1", answer).speed_mps <= 3.0 * 0.2 + 3.0 * 0.1 + 1e-9
        floor.step({"1": answer})


def test_without_a_command_a_robot_is_told_to_brake_at_once():
    floor = Floor(1)
    floor.sends("1", 0.0, 0.0, 0.0, 1.0)
    floor.look()
    answer = floor.answer("1", 1.0)
    begun_mps = floor.core.twist("1", answer).speed_mps
    floor.step({"1": answer})
    twists = []
    for _ in range(8):
        floor.sends("1", 0.0, 0.0, 0.0, begun_mps)
        floor.look()
        twists.append(floor.core.twist("1"))
        floor.step()
        begun_mps = twists[-1].speed_mps
    withheld = Command.withheld_at(EPOCH, "1", floor.core.step)
    assert floor.core.twist("1", withheld) == floor.core.twist("1")
    floor.step({"1": withheld})
    floor.sends("1")
    floor.look()
    assert floor.core.truth().robots["1"].deadline_misses == 9
    assert begun_mps == pytest.approx(0.0, abs=1e-6)
    assert all(twist.turn_rate_radps == 0.0 for twist in twists)
    assert [t.speed_mps for t in twists[:3]] == pytest.approx([0.8, 0.5, 0.2])


def test_the_accuracy_is_that_of_the_worst_and_grows_with_age():
    floor = Floor(unstated_accuracy={"position_m": 0.01, "heading_rad": 0.02, "speed_mps": 0.03})
    exact = {"pose_covariance": diagonal(x=1e-8, y=1e-8, yaw=1e-8), "twist_covariance": diagonal(x=1e-8)}
    floor.sends("1", **exact)
    floor.look()
    alone = floor.core.observations()["1"].accuracy
    assert alone.as_tuple() == pytest.approx((1e-4,) * 4)
    floor.sends("2", 3.0)
    floor.look()
    assert floor.core.observations()["1"].accuracy.as_tuple() == pytest.approx((0.01, 0.01, 0.02, 0.03))
    floor.now_s += 0.1
    floor.look()
    older = floor.core.observations()["1"].accuracy
    assert older.speed_mps == pytest.approx(math.hypot(0.03, 3.0 * 0.1 / math.sqrt(3)))


def test_the_truth_measures_ways_and_distances_and_knows_no_arrivals():
    floor = Floor()
    floor.all_send()
    floor.look()
    floor.step()
    floor.sends("1", 0.3, 0.0)
    floor.sends("2", 0.3, 0.5)
    floor.look()
    truth = floor.core.truth()
    assert truth.minimum_distance_m == pytest.approx(0.5)
    assert truth.collisions == (("1", "2"),)
    assert truth.robots["1"].driven_m == pytest.approx(0.3)
    assert truth.robots["1"].arrived_s is None
    assert truth.verdict is None
    assert not floor.core.over
    floor.core.interrupt()
    assert floor.core.over
