"""Training whose process is killed, whenever that is, gives the weights of one that was left alone."""

import random
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
from rabbit_command import RABBIT
from rl_cbf_clf_controller.weights import Arrays, read

TINY = ("--problem", "rl-clf-qp", "--episodes", "4", "--nominal-episodes", "1", "--walking-steps", "1", "--batch", "8")
UPDATES = ("--updates-least", "40", "--updates-per-tick", "0")


def start(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    """`rabbit train` in a process of its own."""
    command = (*RABBIT, "train", "--out", str(folder), *TINY, *UPDATES, *more)
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def finish(training: subprocess.Popen[bytes]) -> None:
    """Let it end well."""
    _, said = training.communicate(timeout=300)
    assert training.returncode == 0, said.decode()


def weights(folder: Path) -> Arrays:
    """Of the last policy; its metadata has the command, and with it the folder."""
    return read(folder / "policy.safetensors").arrays


def wait_for_an_episode(training: subprocess.Popen[bytes], checkpoint: Path, seen: int) -> None:
    """Until a checkpoint was replaced or the process has ended."""
    while training.poll() is None and not (checkpoint.exists() and checkpoint.stat().st_mtime_ns > seen):
        time.sleep(0.01)


def test_killed_training_gives_the_same_weights(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    finish(start(whole))
    checkpoint, moments, codes = cut / "checkpoint.pt", random.Random(1), []
    for _ in range(2):
        seen = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
        training = start(cut)
        wait_for_an_episode(training, checkpoint, seen)
        time.sleep(moments.uniform(0.0, 0.4))
        training.send_signal(signal.SIGKILL)
        training.communicate()
        codes.append(training.returncode)
    assert codes[0] == -signal.SIGKILL
    finish(start(cut))
    killed, expected = weights(cut), weights(whole)
    assert killed.keys() == expected.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(killed[name], array, name)
