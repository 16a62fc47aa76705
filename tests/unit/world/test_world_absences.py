"""Robots that are not in the scene: not seen, not met, not awaited; and commands that are withheld."""

import pytest
from structlog.testing import capture_logs
from world_helpers import EPOCH, at, command, lanes, sprint
from world_stage import Stage

from protocol.scenario import Pose, Scenario, Sensing
from world.sensing import Sensors
from world.world import World

NOISY = Sensing(range_m=10, position_noise_m=0.05, heading_noise_rad=0.1, speed_noise_mps=0.2, dropout=0.3)


def with_absences(scenario: Scenario, robot: str, *absences_s: tuple[float, float]) -> Scenario:
    robots = [
        each.model_copy(update={"absences_s": absences_s}) if each.id == robot else each
        for each in scenario.robots
    ]
    return scenario.model_copy(update={"robots": robots})


def sprinting(world: World, steps: int, robots: str = "123") -> World:
    """These robots are given their sprints, in the scene or not."""
    while world.step < steps and not world.over:
        world.advance({robot: command(robot, world.step, sprint(world.step)) for robot in robots})
    return world


def test_an_absent_robot_neither_observes_nor_is_observed():
    world = World(with_absences(lanes(3), "2", (0.2, 0.5)), seed=0, epoch=EPOCH)
    for step in range(8):
        there = {"1", "3"} if step in (2, 3, 4) else {"1", "2", "3"}
        assert set(world.present) == world.observations().keys() == world.truth().robots.keys() == there
        assert all(seen.robots.keys() == there for seen in world.observations().values())
        world.advance({"1": command("1", step), "3": command("3", step)})
    misses = {name: robot.deadline_misses for name, robot in world.truth().robots.items()}
    assert misses == {"1": 0, "2": 5, "3": 0}, "none while it is absent"


def test_an_absent_robot_stays_where_it_is_whatever_it_is_told_and_stands_when_it_is_back():
    world = World(with_absences(lanes(2, length_m=9.0), "2", (0.5, 0.8)), seed=0, epoch=EPOCH)
    before = sprinting(world, 4).truth().robots["2"]
    assert before.state.speed_mps == pytest.approx(0.4)
    back = sprinting(world, 8).truth().robots["2"]
    last_m = before.state.x_m + 0.1 * before.state.speed_mps
    assert back.state.x_m == pytest.approx(last_m), "where it was when it left, at step 5"
    assert back.state.speed_mps == back.acceleration_mps2 == back.turn_rate_radps == 0.0
    assert back.driven_m == pytest.approx(before.state.x_m), "only what it drove in the scene"
    after = sprinting(world, 10).truth().robots["2"]
    assert after.state.speed_mps == pytest.approx(2 * 0.1 * sprint(8))


@pytest.mark.parametrize("absences_s", [(), ((0.0, 3.0),)])
def test_an_absent_robot_is_not_met(absences_s):
    """Robot 1 drives through where robot 2 is."""
    first, second = lanes(2, length_m=9.0).robots
    second = second.model_copy(update={"start": Pose(x_m=1.5, y_m=0.0), "absences_s": absences_s})
    world = World(Scenario(name="meeting", robots=[first, second]), seed=0, epoch=EPOCH)
    while world.step < 29:
        world.advance({"1": command("1", world.step, 1.0)})
    truth = world.truth()
    assert truth.robots["1"].state.x_m > 3.0
    assert bool(truth.collisions) == (truth.minimum_distance_m is not None) == (not absences_s)


@pytest.mark.parametrize(
    ("absence_s", "end"),
    [((0.5, 10.0), None), ((2.5, 1e5), 25), ((0.5, 1e5), 20)],
    ids=["comes back", "leaves later", "has left"],
)
def test_a_robot_is_awaited_unless_it_has_left_for_good(absence_s, end):
    world = World(with_absences(lanes(3), "2", absence_s), seed=0, epoch=EPOCH)
    truth = sprinting(world, 25, "13").truth()
    assert [truth.robots[robot].arrived_s for robot in "13"] == [2.0, 2.0]
    assert (truth.verdict, truth.step) == (("arrived", end) if end else (None, 25))


def test_lock_step_does_not_wait_for_robots_that_are_not_in_the_scene():
    """Although they are connected; and it does from the step on at which they are back."""
    stage = Stage(scenario=with_absences(lanes(2, time_limit_s=1.0), "2", (0.2, 0.6)))
    waited = []

    def answer_late():
        waited.append(stage.world.step)
        stage.bus.answer("2", stage.world.step)

    stage.bus.at_step[1] = lambda: stage.bus.silent.add("2")
    stage.inbox.script = [answer_late] * 5
    assert stage.drive().verdict == "timeout"
    assert waited == [6, 7, 8, 9]
    assert stage.misses() == {"1": 0, "2": 0}


def test_a_withheld_command_is_a_miss_and_nothing_else_is_awaited():
    stage = Stage(time_limit_s=0.5)
    stage.bus.silent = {"2"}
    for step in range(5):
        stage.bus.at_step[step] = lambda step=step: stage.bus.answer("2", step, withheld=True)
    with capture_logs() as log:
        assert stage.drive().verdict == "timeout"
    told = [entry["steps_by_robot"] for entry in log if "steps_by_robot" in entry]
    assert [sum(each.values()) for each in told] == [1, 4]
    assert all(each.keys() == {"2"} for each in told)
    assert stage.now() == 0.0, "lock-step does not wait for what will not come"
    assert stage.misses() == {"1": 0, "2": 5}
    assert stage.bus.truths[-1].refused == {}


STATES = {"1": at(0.0, 0.0), "2": at(3.0, 0.0), "3": at(0.0, 3.0)}


def test_what_is_seen_of_those_present_does_not_depend_on_who_is_absent():
    """Nor on who is out of range: noise and dropouts are drawn for everybody, so nobody's luck is shifted."""
    full, part, short = (Sensors("1", NOISY, seed=0, index=0) for _ in range(3))
    for step in range(40):
        everybody = full.see(STATES).robots
        others = {name: each for name, each in everybody.items() if name != "2" or not step % 2}
        assert part.see(STATES, ["1", "3"] if step % 2 else None).robots == others
        assert short.see(STATES if not step % 2 else STATES | {"2": at(100.0, 0.0)}).robots == others
