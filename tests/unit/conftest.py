"""A short walk, and recordings of it."""

from recorded_walk import walk, write_bag

__all__ = ["walk", "write_bag"]
