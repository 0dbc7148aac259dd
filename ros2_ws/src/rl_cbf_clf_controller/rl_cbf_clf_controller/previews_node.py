"""The previews that were heard: one for each stone, of the present episode and of those that may come."""

from rabbit_description.state import StonePreview
from rabbit_ros.door import Refused

NEWEST = 20  # as many as are latched


class Previews:
    """By episode and index of the stone."""

    def __init__(self) -> None:
        self._stones: dict[tuple[int, int], StonePreview] = {}

    def add(self, episode: int, stone: StonePreview, present: int) -> None:
        """Keep a preview while episode `present` is walked.

        Raises:
            Refused: of an episode before it, or other edges than were told before.
        """
        if episode < present:
            raise Refused("late", f"stone {stone.index} of episode {episode}; expected {present} or later")
        before = self._stones.get((episode, stone.index), stone)
        if before != stone:
            raise Refused("told otherwise", f"{stone} of episode {episode}; it was {before}")
        self._stones[episode, stone.index] = stone
        while len(self._stones) > NEWEST:
            del self._stones[self._least_wanted(present)]

    def get(self, episode: int, index: int) -> StonePreview | None:
        """The stone with this index; None if it was not heard of."""
        return self._stones.get((episode, index))

    def _least_wanted(self, present: int) -> tuple[int, int]:
        """Of another episode, if there is one; else the oldest stone."""
        return min(self._stones, key=lambda key: (key[0] == present, key))
