"""Messages that went past the recorder, by their publisher's own count of them.

A publisher numbers what it sends from 1. A number left out is a message lost; one that is no higher than the last is of
a publisher that was started anew. What was sent before the first one heard is not counted: it was not for this reader.
"""

from collections import Counter
from dataclasses import dataclass, field

UNKNOWN = 2**63  # and above: the middleware does not number


@dataclass
class Loss:
    """`lost` messages by topic; every topic that was heard is in it."""

    lost: Counter[str] = field(default_factory=Counter)
    _newest: dict[str, int] = field(default_factory=dict)

    def heard(self, topic: str, number: int) -> None:
        """Message `number` of its publisher came in."""
        if number >= UNKNOWN:
            return
        last = self._newest.get(topic, number - 1)
        self.lost[topic] += max(0, number - last - 1)
        self._newest[topic] = number
