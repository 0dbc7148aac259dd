"""Messages that went past the recorder, by their publishers' own counts of them.

A publisher numbers what it sends from 1. A number left out is a message lost; one below all that are known is of
another publisher: started again, or a stranger's. What was sent before the first one heard is not counted: it was not
for this reader. While a topic has several publishers, a number far above all that are known may be the first one heard
of another, and is not counted either.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

UNKNOWN = 2**63  # and above: the middleware does not number


@dataclass
class Loss:
    """`lost` messages by topic; every topic that was heard is in it."""

    lost: Counter[str] = field(default_factory=Counter)
    _newest: dict[str, set[int]] = field(default_factory=dict)  # of each publisher

    def heard(self, topic: str, number: int, publishers: Callable[[], int]) -> None:
        """Message `number` of its publisher came in; `publishers` counts those of the topic."""
        if number >= UNKNOWN:
            return
        newest = self._newest.setdefault(topic, set())
        last = max((each for each in newest if each < number), default=number - 1)  # of the same publisher
        if number - last > 1 and publishers() > 1:
            last = number - 1
        self.lost[topic] += number - last - 1
        newest.discard(last)
        newest.add(number)
