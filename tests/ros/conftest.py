"""Tests that start nodes: on a ROS domain of their own, on this machine only, one after another in one worker."""

import os
from pathlib import Path

import pytest

HERE = Path(__file__).parent
DOMAINS = 100  # domain ids above 101 may meet the ephemeral ports

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % DOMAINS)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep these tests in one worker: two graphs at once would share the processor."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.xdist_group("ros"))
