"""A short walk, and recordings of it; a task's file."""

from own_cart import cart
from recorded_walk import walk, write_bag

__all__ = ["cart", "walk", "write_bag"]
