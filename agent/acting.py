"""Act: from a plan, or from the lack of one, to the input of this step."""

from agent.planning import Plan
from protocol.vehicle import Input, Limits, reachable_inputs


def first_input(plan: Plan, limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The receding horizon: only the plan's first input is driven.

    Solvers keep limits to a tolerance; what is commanded keeps those of inputs and rates exactly, and that of
    the speed as far as they allow.
    """
    turn_rate, acceleration = plan.inputs[0].tolist()
    slowest, fastest = ((bound - speed_mps) / step_s for bound in (-limits.speed_mps, limits.speed_mps))
    wanted = Input(turn_rate, min(max(acceleration, slowest), fastest))
    return reachable_inputs(limits, previous, step_s).clip(wanted)


def without_a_plan(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The publication's rule for a step at which a problem was not solved.

    Going forward (or standing), the lowest reachable acceleration and turn rate; in reverse, the highest.
    """
    lowest, highest = reachable_inputs(limits, previous, step_s)
    return lowest if speed_mps >= 0 else highest
