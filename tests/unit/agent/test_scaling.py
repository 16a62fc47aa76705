"""A crossing of any size is the same crossing: no robot depends on the unit of length or that of cost."""

from functools import cache

import numpy as np
import pytest

from agent.process.options import DecisionOptions
from agent.solve.vehicle import Array
from protocol.scenario import Pose, Scenario, ScenarioRobot, load_scenario
from protocol.scene import Area, Weights
from protocol.vehicle import Limits
from scenarios import find
from world.world import World

CROSSING = load_scenario(find("2-crossing")).model_copy(update={"arrival_tolerance": 1e-9})
"""Nobody arrives: that is judged by metres and radians alike, as the publication has it."""
TOLERANCE = 1e-6
"""Of positions relative to the safety distance. Other numbers round otherwise, which makes 1e-9."""
SHORT, WHOLE = 25, 60
"""In steps: until both have seen who goes first, and until they park."""


def scaled(scenario: Scenario, size: float, price: float) -> Scenario:
    """The same in another unit of length, and with all costs times a price."""

    def there(pose: Pose) -> Pose:
        return pose.model_copy(update={"x_m": size * pose.x_m, "y_m": size * pose.y_m})

    def robot(each: ScenarioRobot) -> ScenarioRobot:
        limits = {
            name: (size if name in ("speed_mps", "acceleration_mps2", "jerk_mps3") else 1.0) * value
            for name, value in each.limits
        }
        changes = {"limits": Limits(**limits), "start": there(each.start), "goal": there(each.goal)}
        return each.model_copy(update=changes | {"radius_m": size * each.radius_m})

    weights = scenario.weights
    changes = {
        "robots": [robot(each) for each in scenario.robots],
        "safety_margin_m": size * scenario.safety_margin_m,
        "area": Area(**{name: size * value for name, value in scenario.area}),
        "weights": Weights(
            x=price * weights.x,
            y=price * weights.y,
            heading=price * size**2 * weights.heading,  # m² are compared with rad²
            speed=price * weights.speed,
        ),
    }
    return scenario.model_copy(update=changes)


@cache
def driven(size: float, price: float, steps: int) -> Array:
    """Positions (steps, robots, 2) in parts of the size."""
    scenario = scaled(CROSSING, size, price)
    world, scene = World(scenario, seed=0, epoch=0), scenario.scene(with_goals=False)
    agents = {
        robot.id: DecisionOptions().agent(robot.id, robot.goal_pose(), scene, lambda: 0.0)
        for robot in scenario.robots
    }
    found = []
    for _ in range(steps):
        decisions = {robot: agents[robot].decide(seen) for robot, seen in world.observations().items()}
        world.advance({robot: decision.command for robot, decision in decisions.items() if decision})
        robots = world.truth().robots.values()
        found.append([(robot.state.x_m, robot.state.y_m) for robot in robots])
    return np.array(found) / size


def away(size: float, price: float, steps: int) -> float:
    """How far it takes the robots from where they are otherwise, in parts of the safety distance."""
    safety_m = CROSSING.scene(with_goals=False).safety_distance_m("1", "2")
    other_m = np.linalg.norm(driven(size, price, steps) - driven(1.0, 1.0, steps), axis=-1)
    return float(other_m.max()) / safety_m


@pytest.mark.parametrize(("size", "price"), [(0.02, 1e3), (50.0, 1e-2)])
def test_a_crossing_of_another_size_and_price_is_the_same(size: float, price: float) -> None:
    assert away(size, price, SHORT) < TOLERANCE
    assert np.ptp(driven(1.0, 1.0, SHORT), axis=0).max() > 2.0, "they are on their way"


def test_powers_of_two_change_no_bit() -> None:
    assert away(2.0**-6, 2.0**10, SHORT) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "price"),
    [*((size, 1.0) for size in (0.02, 0.1, 10.0, 50.0)), *((1.0, 10.0**power) for power in range(-2, 4))],
)
def test_so_it_is_until_they_park(size: float, price: float) -> None:
    assert away(size, price, WHOLE) < TOLERANCE
