"""What the browser tests look through: `make test-browser`. Without a Chromium they are skipped, and say so."""

from collections.abc import Iterator

import pytest
from chromium import Chromium, find_chromium
from recorded_walk import walk, write_bag

__all__ = ["walk", "write_bag"]


@pytest.fixture
def chromium() -> Iterator[Chromium]:
    """A browser that has no window when a test begins."""
    if find_chromium() is None:
        pytest.skip("no Chromium on this machine: apt install chromium")
    with Chromium() as started:
        yield started
