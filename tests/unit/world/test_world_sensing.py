import math

import numpy as np
import pytest
from world_helpers import at

from protocol.scenario import Sensing
from world.sensing import Sensors

SIGMAS = 4.5
"""A normal variable leaves ±4.5 σ once in 150,000 draws; the seeds are fixed besides."""
COUNT = 4000
NOISY = Sensing(position_noise_m=0.05, heading_noise_rad=0.1, speed_noise_mps=0.2)
STATES = {"1": at(0.0, 0.0, 1.0, 0.5), "2": at(3.0, 4.0, -2.0, 1.5), "3": at(-6.0, 0.0, 0.0, -1.0)}


def sensors(sensing, observer="1", seed=0, index=0):
    return Sensors(observer, sensing, seed=seed, index=index)


def errors(seen, robot, count=COUNT):
    """Measured minus true, shape (count, 4)."""
    return np.array([seen.see(STATES).robots[robot].as_tuple() for _ in range(count)]) - np.array(
        STATES[robot]
    )


def test_headings_are_measured_within_half_a_turn():
    states = {"1": at(0.0, 0.0, 4.0 * math.tau + 1.0), "2": at(5.0, 0.0, math.pi + 0.5)}
    view = sensors(Sensing()).see(states).robots
    assert view["1"].as_tuple() == pytest.approx((0.0, 0.0, 1.0, 0.0))
    assert view["2"].heading_rad == pytest.approx(0.5 - math.pi)
    noisy = sensors(Sensing(heading_noise_rad=1.0))
    states = {"1": at(0.0, 0.0, math.pi)}
    assert all(abs(noisy.see(states).robots["1"].heading_rad) <= math.pi for _ in range(100))


@pytest.mark.parametrize("robot", ["1", "2"])
def test_noise_has_no_bias_and_the_stated_deviation(robot):
    found, sigma = errors(sensors(NOISY), robot), np.array(sensors(NOISY).accuracy.as_tuple())
    assert sigma.tolist() == [0.05, 0.05, 0.1, 0.2]
    assert np.all(np.abs(found.mean(axis=0)) < SIGMAS * sigma / math.sqrt(COUNT))
    assert np.all(np.abs(found.std(axis=0) - sigma) < SIGMAS * sigma / math.sqrt(2 * COUNT))


def correlation(one, other):
    return np.corrcoef(one.ravel(), other.ravel())[0, 1]


def test_errors_of_steps_robots_observers_and_seeds_are_independent():
    scale = np.array([0.05, 0.05, 0.1, 0.2])
    here = errors(sensors(NOISY), "2") / scale
    bound = SIGMAS / math.sqrt(here.size)
    assert abs(correlation(here[1:], here[:-1])) < bound
    assert abs(correlation(here, errors(sensors(NOISY), "3") / scale)) < bound
    assert abs(correlation(here, errors(sensors(NOISY, "3", index=2), "2") / scale)) < bound
    assert abs(correlation(here, errors(sensors(NOISY, seed=1), "2") / scale)) < bound


def test_others_are_seen_up_to_the_range_and_dropouts_come_as_often_as_stated_but_hit_never_the_observer():
    assert sensors(Sensing(range_m=5.0)).see(STATES).robots.keys() == {"1", "2"}
    assert sensors(Sensing(range_m=4.999)).see(STATES).robots.keys() == {"1"}
    assert sensors(Sensing(dropout=1.0)).see(STATES).robots.keys() == {"1"}
    seen = sensors(Sensing(dropout=0.3))
    views = [seen.see(STATES).robots for _ in range(COUNT)]
    assert all("1" in view for view in views)
    bound = SIGMAS * math.sqrt(0.3 * 0.7 / COUNT)
    missing = {robot: np.array([robot not in view for view in views]) for robot in ("2", "3")}
    assert abs(missing["2"].mean() - 0.3) < bound
    assert abs(missing["3"].mean() - 0.3) < bound
    assert abs(correlation(missing["2"], missing["3"])) < SIGMAS / math.sqrt(COUNT)


def moving(step):
    return {robot: state._replace(x_m=state.x_m + step) for robot, state in STATES.items()}


def test_a_delayed_view_is_the_view_of_then_with_its_noise_range_and_dropouts():
    sensing = NOISY.model_copy(update={"range_m": 8.0, "dropout": 0.3})
    prompt, late = sensors(sensing), sensors(sensing.model_copy(update={"delay_steps": 3}))
    views = [(prompt.see(moving(step)).robots, late.see(moving(step)).robots) for step in range(30)]
    for step, (now, delayed) in enumerate(views):
        assert {**views[max(step - 3, 0)][0], "1": now["1"]} == delayed
    assert late.see(STATES).age_steps == 3
