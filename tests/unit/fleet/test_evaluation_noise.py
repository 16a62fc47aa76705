"""The levels that ``--noise`` takes."""

import math
import re

import pytest

from fleet.evaluate.evaluation import levels_in, sensing_of
from protocol.scenario import Sensing

LOW = {"position_noise_m": 0.02, "heading_noise_rad": math.radians(2.0), "speed_noise_mps": 0.05}


@pytest.mark.parametrize(
    ("level", "sensing"),
    [
        ("low", LOW),
        ("dropout=0.3", {"dropout": 0.3}),
        ("delay_steps=2", {"delay_steps": 2}),
        ("range_m=5", {"range_m": 5}),
        ("low+dropout=0.3+delay_steps=2", {**LOW, "dropout": 0.3, "delay_steps": 2}),
        ("position_noise_m=1e-2+speed_noise_mps=0", {"position_noise_m": 0.01}),
    ],
)
def test_a_level_is_made_of_names_and_fields(level, sensing):
    assert sensing_of(level) == Sensing(**sensing)


def test_a_list_of_levels_names_each_once():
    assert levels_in("none, low,low+delay_steps=2,none") == ("none", "low", "low+delay_steps=2")


@pytest.mark.parametrize(
    ("level", "told"),
    [
        ("deafening", "'deafening' found, one of low, medium, high or FIELD=VALUE is expected"),
        ("", "'' found"),
        ("low+", "'' found"),
        ("none+low", "'none' found"),
        ("loudness=3", "'loudness' found, one of range_m, position_noise_m, "),
        ("dropout=often", "dropout=often found, a number is expected after ="),
        ("dropout=2", "'dropout=2': dropout: Input should be less than or equal to 1, found 2"),
        ("delay_steps=1.5", "delay_steps: Input should be a valid integer, found 1.5"),
        ("delay_steps=11", "delay_steps: Input should be less than or equal to 10, found 11"),
        ("dropout=nan", "dropout: Input should be a finite number"),
        ("low+position_noise_m=0.1", "'low+position_noise_m=0.1' says position_noise_m twice"),
        ("dropout=0.1+dropout=0.2", "says dropout twice"),
    ],
)
def test_a_level_that_cannot_be_understood_is_refused_with_what_is_expected(level, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        levels_in(f"none,{level}")
