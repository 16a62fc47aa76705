"""The solver is compiled before a run begins, once on a machine."""

from agent.process.warm import CompilingError, compile_in_background
from agent.solve.compiled import is_complete
from fleet.interruption import Interruption
from fleet.run.crew import ProcessFailedError


def compile_solver(interruption: Interruption) -> None:
    """Wait until the solver is compiled, which takes no time where it has been.

    Raises:
        ProcessFailedError: it cannot be compiled or kept.
        KeyboardInterrupt: an interruption came before.
    """
    try:
        compiled = compile_in_background(unwanted=lambda: interruption.requested)
    except CompilingError as error:
        raise ProcessFailedError(str(error)) from None
    if not compiled:
        raise KeyboardInterrupt


def announced(begin: str) -> str:
    """What a run does first, with the wait for the solver if there is one."""
    if is_complete():
        return begin
    return f"compiling the solver (once on this machine, about a minute), then {begin}"
