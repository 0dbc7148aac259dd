"""Tests of campaigns at running nodes, in the world of `tests/ros`."""

from tests.ros.conftest import SHORT, make_world

__all__ = ["SHORT", "make_world"]
