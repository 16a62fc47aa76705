import structlog
from structlog.testing import capture_logs

from agent.process.inbox import LATE_EVERY_S, LateDecisions


def test_a_late_decision_is_told_at_once_and_those_after_it_in_sum():
    now_s = 50.0
    with capture_logs() as log:
        late = LateDecisions(structlog.get_logger(), lambda: now_s)
        for step in range(10):
            late.add(step)
        now_s += LATE_EVERY_S
        late.add(10)
        late.add(11)
    assert [(entry["step"], entry["so_far"]) for entry in log] == [(0, 1), (10, 11)]
    assert late.count == 12
