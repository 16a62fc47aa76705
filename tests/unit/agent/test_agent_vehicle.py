"""The vehicle model against a plain loop, closed forms and the symbolic step."""

import casadi as ca
import numpy as np
from agent_helpers import STEP_S, euler
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agent.solve.reference import symbolic_step
from agent.solve.vehicle import recovered_inputs, rollout

numbers = st.floats(-5.0, 5.0, allow_subnormal=False)
states = arrays(float, 4, elements=numbers)
input_sequences = st.integers(1, 12).flatmap(lambda steps: arrays(float, (steps, 2), elements=numbers))
steps_s = st.sampled_from([0.02, 0.1, 0.5])


@given(states, input_sequences, steps_s)
def test_a_rollout_is_the_euler_loop_and_its_inputs_are_recovered(state, inputs, step_s):
    path = rollout(state, inputs, step_s)
    np.testing.assert_allclose(path, euler(state, inputs, step_s), atol=1e-11)
    np.testing.assert_allclose(recovered_inputs(path, step_s), inputs, atol=1e-9)


def test_a_rollout_of_many_robots_is_the_rollout_of_each():
    random = np.random.default_rng(1)
    many, inputs = random.normal(size=(3, 4)), random.normal(size=(3, 7, 2))
    together = rollout(many, inputs, STEP_S)
    assert together.shape == (3, 8, 4)
    for alone, state, control in zip(together, many, inputs, strict=True):
        np.testing.assert_array_equal(alone, rollout(state, control, STEP_S))


@settings(max_examples=20)
@given(states, arrays(float, 2, elements=numbers), steps_s)
def test_the_symbolic_step_is_one_step_of_the_rollout(state, control, step_s):
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    step = ca.Function("step", [x, u], [symbolic_step(x, u, step_s)])
    moved = np.asarray(step(state, control)).ravel()
    np.testing.assert_allclose(moved, rollout(state, control[None], step_s)[-1], atol=1e-12)
