"""How a walk ended, as an exit code: that of `rabbit walk`."""

import signal
from collections.abc import Sequence
from enum import IntEnum


class ExitCode(IntEnum):
    """The greater, the worse: of several episodes the worst counts. An interrupted command has 128 + the signal."""

    WALKED = 0
    FELL = 1
    REFUSED = 2
    FAULT = 3
    NODE_DIED = 4

    @property
    def word(self) -> str:
        """Its word, as in `node died`."""
        return self.name.lower().replace("_", " ")


CUT_SHORT = "reset"  # the outcome of an episode that another one replaces, as `reset_episode` asks for
OF_THE_GRAPH = ("fault", "silent", CUT_SHORT)  # outcomes that are not the robot's

MEANINGS = {
    ExitCode.WALKED: "every episode was walked to its end",
    ExitCode.FELL: "an episode ended as miss, gap_fall, fall, slip, flight, stall or diverged",
    ExitCode.REFUSED: "an option, parameter or file cannot be used, or another graph is there",
    ExitCode.FAULT: "an episode ended as fault, silent or reset: the graph, not the robot",
    ExitCode.NODE_DIED: "a node ended by itself, could not be started or was not ready in time",
}
EPILOG = "\n".join(
    [
        "\b",  # one line each
        "Exit codes, the worst of all episodes:",
        *(f"{code.value}  {code.word}: {text}" for code, text in MEANINGS.items()),
        "128 + n  interrupted by signal n: 130 SIGINT (Ctrl-C), 143 SIGTERM, 129 SIGHUP",
    ]
)


def counted(outcomes: Sequence[str]) -> list[str]:
    """Without episodes that were cut short and replaced; one that nothing follows counts."""
    return [outcome for outcome in outcomes[:-1] if outcome != CUT_SHORT] + list(outcomes[-1:])


def of_walk(outcomes: Sequence[str]) -> ExitCode:
    """The exit code of a walk whose episodes ended so, in their order; without any it is a fault."""
    codes = {"walked": ExitCode.WALKED, "done": ExitCode.WALKED, **dict.fromkeys(OF_THE_GRAPH, ExitCode.FAULT)}
    return max((codes.get(outcome, ExitCode.FELL) for outcome in counted(outcomes)), default=ExitCode.FAULT)


def of_signal(number: int) -> int:
    """The exit code of a command that a signal ended."""
    return 128 + signal.Signals(number)


class Interrupted(KeyboardInterrupt):
    """A signal asked the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = of_signal(number)


def of_interrupt(error: KeyboardInterrupt) -> int:
    """The exit code of a command that it ended; a plain one is Ctrl-C's."""
    return error.code if isinstance(error, Interrupted) else of_signal(signal.SIGINT)
