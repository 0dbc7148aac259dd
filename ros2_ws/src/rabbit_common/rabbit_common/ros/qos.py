"""QoS profiles by role. The names are those of docs/topics.md.

Histories are deeper than lock-step needs, so that a trainer or recorder that falls behind for a while loses nothing.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _reliable(durability: DurabilityPolicy, depth: int) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


TICK = _reliable(DurabilityPolicy.VOLATILE, 5000)
"""One message a tick, none lost: 50 s of walking."""

EVENT = _reliable(DurabilityPolicy.TRANSIENT_LOCAL, 20)
"""Rare and latched: a late reader gets the newest ones."""

WEIGHTS = _reliable(DurabilityPolicy.TRANSIENT_LOCAL, 1)
"""Half a megabyte and latched: a late reader gets the newest one only."""

DIAGNOSTICS = _reliable(DurabilityPolicy.VOLATILE, 10)
"""Once a second."""
