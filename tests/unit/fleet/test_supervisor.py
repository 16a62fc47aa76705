"""Who is started again, after which pause, and who is given up."""

import pytest

from fleet.inject.process_faults import WORLD
from fleet.run.processes import BACK_OFF_S, Processes, Restart, Supervisor


class ScriptedProcesses(Processes):
    """Processes that end when a test says so."""

    def __init__(self) -> None:
        self.down: dict[str, int] = {}
        self.started: list[tuple[str, float]] = []
        self.now_s = 0.0

    def statuses(self) -> dict[str, int]:
        return dict(self.down)

    def account(self, name: str) -> str:
        return f"{name} ended"

    def start_again(self, name: str) -> None:
        del self.down[name]
        self.started.append((name, self.now_s))


@pytest.fixture
def processes() -> ScriptedProcesses:
    return ScriptedProcesses()


def supervisor(processes: ScriptedProcesses, restart: Restart) -> Supervisor:
    return Supervisor(processes, restart, lambda: processes.now_s)


def look_for(processes: ScriptedProcesses, watched: Supervisor, duration_s: float) -> None:
    until_s = processes.now_s + duration_s
    while processes.now_s < until_s:
        watched.look()
        processes.now_s += 0.125


def test_whoever_fails_at_every_start_is_given_up_after_growing_pauses(processes: ScriptedProcesses) -> None:
    watched = supervisor(processes, Restart.ON_FAILURE)
    pauses_s = []
    for _ in BACK_OFF_S:
        processes.down["robot-1"], ended_s = 1, processes.now_s
        while "robot-1" in processes.down:
            watched.look()
            processes.now_s += 0.125
        pauses_s.append(processes.started[-1][1] - ended_s)
    assert pauses_s == list(BACK_OFF_S)
    assert watched.lost == {}
    processes.down["robot-1"] = 1
    look_for(processes, watched, 20.0)
    assert watched.lost == {"robot-1": "robot-1 ended"}
    assert len(processes.started) == len(BACK_OFF_S)


def test_nobody_is_started_again_unasked(processes: ScriptedProcesses) -> None:
    watched = supervisor(processes, Restart.NEVER)
    processes.down["robot-1"] = -9
    look_for(processes, watched, 20.0)
    assert (processes.started, watched.lost) == ([], {"robot-1": "robot-1 ended"})


def test_an_end_that_is_wanted_is_no_loss(processes: ScriptedProcesses) -> None:
    watched = supervisor(processes, Restart.ON_FAILURE)
    watched.excuse("robot-1")
    processes.down["robot-1"] = -9
    look_for(processes, watched, 20.0)
    assert (processes.started, watched.lost) == ([], {})
    watched.expect("robot-1")
    look_for(processes, watched, 20.0)
    assert [name for name, _ in processes.started] == ["robot-1"]


@pytest.mark.parametrize(("status", "returns"), [(0, False), (1, False), (3, True), (-9, True)])
def test_a_world_that_has_given_its_verdict_is_not_started_again(
    processes: ScriptedProcesses, status: int, returns: bool
) -> None:
    watched = supervisor(processes, Restart.ON_FAILURE)
    processes.down[WORLD] = status
    look_for(processes, watched, 1.0)
    assert [name for name, _ in processes.started] == [WORLD] * returns
    assert (WORLD in watched.lost) is not returns


def test_nothing_is_started_once_the_run_is_to_end(processes: ScriptedProcesses) -> None:
    watched = supervisor(processes, Restart.ON_FAILURE)
    processes.down[WORLD] = -9
    watched.look()
    watched.give_up_restarting()
    look_for(processes, watched, 20.0)
    assert processes.started == []
    assert WORLD in watched.lost
