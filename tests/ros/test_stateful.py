"""Sequences of what may happen to a running graph; after every few steps a good episode must walk."""

from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from .stateful.machine import GraphMachine
from .stateful.sequence import Shared

SHORT = settings(max_examples=3, stateful_step_count=10, derandomize=True)


@pytest.mark.timeout(7200)
def test_whatever_happens_a_good_episode_walks(tmp_path: Path) -> None:
    Shared.folder = tmp_path
    try:
        run_state_machine_as_test(GraphMachine, settings=SHORT)
    finally:
        Shared.drop(keep=False)
