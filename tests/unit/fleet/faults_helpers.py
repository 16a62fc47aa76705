"""Faults as a person would write them, links that carry a made-up drive, and short runs with faults."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

from hypothesis import strategies as st

from fleet.inject.fault import KINDS, schedule
from fleet.inject.link import Link
from fleet.inject.scenario import FaultFile, Scenario
from fleet.record.experiment import RunFacts
from fleet.run.virtual import Step, closed_loop
from protocol.codec import MessageError, decode, encode
from protocol.messages import Command, Observation, State, Truth
from protocol.scene import PublicRobot, Scene

EPOCH = 5
STEP_S = 0.1
SCENE = Scene(step_s=STEP_S, robots={"1": PublicRobot(), "2": PublicRobot()})
MEETING = [
    {"id": 1, "start": {"x_m": -4.0, "y_m": 0.0}, "goal": {"x_m": 4.0, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 1.0, "y_m": -4.0}, "goal": {"x_m": 1.0, "y_m": 4.0}},
]
"""They cross each other's way, and both have arrived after less than 6 s."""


def fault(kind: str, **fields: Any) -> dict[str, Any]:
    return {"kind": kind, **fields}


_ways_m = st.sampled_from([-1e6, -1.0, -0.0, 1e-7, 1e6]) | st.floats(-1e6, 1e6)
_times_s = st.sampled_from([0.0, 0.15, 0.7]) | st.floats(0.0, 1e5)
_VALUES: dict[str, st.SearchStrategy[Any]] = {
    "start_s": _times_s | st.tuples(_times_s, _times_s).map(sorted),
    "duration_s": st.sampled_from([0.1, 0.35, 5.0]) | st.floats(0.0, 60.0, exclude_min=True),
    "robots": st.sampled_from([["1"], ["1", "2"]]),
    "rate": st.sampled_from([0.2, 0.7, 1.0]) | st.floats(0.0, 1.0, exclude_min=True),
    "steps": st.integers(1, 10),
    "seen": st.sampled_from(["1", "2"]),
    "x_m": _ways_m,
    "y_m": _ways_m,
    "heading_rad": _ways_m.map(lambda value: value + 0.0),  # -0.0 is not written where 0.0 is the default
    "speed_mps": st.floats(0.0, 1e6),
    "distance_m": st.floats(1e-3, 1e3),
    "factor": st.floats(1e-3, 1.0),
    "weights": st.just({"x": 2.0, "heading": 0.125}),
    "offset_s": st.floats(-1e9, 1e9),
}
"""Of each field that a kind may have."""


@st.composite
def faults_of(draw: st.DrawFn, kinds: Collection[str] = tuple(KINDS)) -> dict[str, Any]:
    """A fault of one of these kinds, with what its class asks for and perhaps with what it allows."""
    kind = draw(st.sampled_from(sorted(kinds)))
    fields = {name: field for name, field in KINDS[kind].model_fields.items() if name != "kind"}
    wanted = [name for name, field in fields.items() if field.is_required() or draw(st.booleans())]
    return {"kind": kind} | {name: draw(_VALUES[name]) for name in wanted}


def parsed(*faults: Mapping[str, Any]) -> tuple[Any, ...]:
    return FaultFile.model_validate({"faults": list(faults)}).faults if faults else ()


def link(*faults: Mapping[str, Any], robot: str = "1", seed: int = 0, scene: Scene = SCENE) -> Link:
    return Link(schedule(parsed(*faults), seed=seed, step_s=STEP_S), robot, scene)


def observation(step: int, **changes: Any) -> Observation:
    """Robot 1 drives along x, robot 2 comes along a parallel line."""
    way_m = 0.1 * step
    robots = {"1": State.of(way_m, 0.0, 0.0, 1.0), "2": State.of(5.0 - way_m, 2.0, 3.0, 1.0)}
    plain = {"epoch": EPOCH, "step": step, "time_s": round(step * STEP_S, 9), "robots": robots}
    return Observation(**(plain | changes))


def command(step: int, **changes: Any) -> Command:
    plain = {"epoch": EPOCH, "robot": "1", "step": step}
    return Command(**(plain | {"turn_rate_radps": 1.0, "acceleration_mps2": 2.0} | changes))


class Arrived(NamedTuple):
    """What reached a robot at a step."""

    messages: tuple[Observation | MessageError, ...]
    answerable: bool

    @property
    def steps(self) -> list[int]:
        return [each.step for each in self.messages if isinstance(each, Observation)]

    @property
    def only(self) -> Observation:
        [message] = self.messages
        assert isinstance(message, Observation)
        return message


def shown(over: Link, steps: int) -> list[Arrived]:
    return [arrived(over, observation(step)) for step in range(steps)]


def arrived(over: Link, seen: Observation) -> Arrived:
    delivery = over.observed(seen)
    return Arrived(tuple(map(_read, delivery.payloads)), delivery.answerable)


def _read(payload: bytes) -> Observation | MessageError:
    try:
        return decode(Observation, payload)
    except MessageError as error:
        return error


def given(over: Link, sent: Command) -> list[Command]:
    return [decode(Command, payload) for payload in over.commanded(encode(sent))]


def due(over: Link, step: int) -> list[Command]:
    return [decode(Command, payload) for payload in over.due(step)]


def scenario(*faults: Mapping[str, Any], **rules: Any) -> Scenario:
    plain = {"name": "meeting", "time_limit_s": 10.0, "robots": MEETING}
    return Scenario.model_validate({**plain, "faults": list(faults), **rules})


def facts(seed: int = 0, **changes: Any) -> RunFacts:
    plain = {"scenario": "meeting", "goals": "joint-fit", "solver": "realtime", "clock": "virtual"}
    return RunFacts(**(plain | {"seed": seed, "run": "test", "version": "0"} | changes))


def drive(*faults: Mapping[str, Any], seed: int = 0, goals: str = "joint-fit", **rules: Any) -> list[Step]:
    """A whole run."""
    return list(run(scenario(*faults, **rules), facts(seed, goals=goals)))


def run(driven: Scenario, of: RunFacts) -> Iterator[Step]:
    return closed_loop(driven, of, clock=lambda: 0.0)


def truths(driven: list[Step]) -> list[Truth]:
    return [step.truth for step in driven]


def place(truth: Truth, robot: str) -> tuple[float, float]:
    state = truth.robots[robot].state
    return state.x_m, state.y_m
