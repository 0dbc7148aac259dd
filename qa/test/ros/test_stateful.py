"""Sequences of what may happen to a running graph; after every few steps a good episode must walk.

`make test-all` runs a few, always the same, and `make fuzz` others for hours. A campaign that can be stopped and goes
on: `python -m qa.test.ros.stateful --help`.
"""

from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from .stateful.machine import GraphMachine
from .stateful.sequence import Shared

HOURS = 6
SHORT = settings(max_examples=4, stateful_step_count=12, derandomize=True)
LONG = settings(max_examples=150, stateful_step_count=30)
CHOSEN = LONG if settings().max_examples > 1000 else SHORT  # of the profile that `make fuzz` chooses


@pytest.mark.timeout(HOURS * 3600)
def test_whatever_happens_a_good_episode_walks(tmp_path: Path) -> None:
    Shared.folder = tmp_path
    try:
        run_state_machine_as_test(GraphMachine, settings=CHOSEN)
    finally:
        Shared.drop(keep=False)
