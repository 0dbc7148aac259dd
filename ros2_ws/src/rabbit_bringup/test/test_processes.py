"""The processes of a walk: no signal is lost, wherever it comes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from rabbit_bringup.launching.processes import ECHO_SECONDS, ENDING, Processes
from rabbit_common.exit_codes import Interrupted

PATIENCE = 180.0  # s
DEAF = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); signal.pause()"


class Last:
    """Sends a signal from its destructor, whose exceptions Python drops."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_that_comes_in_a_destructor_is_not_lost(tmp_path: Path, number: int) -> None:
    processes = Processes(tmp_path)
    before = signal.getsignal(number)
    with suppress(Interrupted), processes.ended_at_last():
        processes.check()
        Last(number)
        with pytest.raises(Interrupted) as raised:
            processes.check()
    assert raised.value.code == 128 + number
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_that_comes_while_the_nodes_end_is_not_lost(tmp_path: Path, number: int) -> None:
    """All nodes have ended by then, and nothing is made of the walk."""
    processes = Processes(tmp_path)
    stop = processes.stop

    def stop_with_signal(names: Sequence[str] = ()) -> None:
        if not names:
            os.kill(os.getpid(), number)
        stop(names)

    processes.stop = stop_with_signal  # type: ignore[method-assign]
    node = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
    with pytest.raises(Interrupted) as raised, processes.ended_at_last():
        processes.running["node"] = node
    assert raised.value.code == 128 + number
    assert node.poll() is not None


def test_a_second_signal_ends_at_once_what_does_not_end_politely(tmp_path: Path) -> None:
    deaf = subprocess.Popen([sys.executable, "-c", DEAF], stdout=subprocess.PIPE, text=True)
    assert deaf.stdout is not None
    assert deaf.stdout.readline() == "deaf\n"
    processes = Processes(tmp_path)
    with suppress(Interrupted), processes.ended_at_last():
        processes.running["deaf"] = deaf
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(2 * ECHO_SECONDS)
    assert deaf.wait(PATIENCE) == -signal.SIGKILL


def test_a_signal_that_comes_twice_at_once_is_one(tmp_path: Path) -> None:
    processes = Processes(tmp_path)
    with suppress(Interrupted), processes.ended_at_last():
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)
        assert not processes._hurry
