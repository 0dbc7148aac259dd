"""The previews that were heard: one for each stone, of the present episode and of the one that may come next."""

from rabbit_description.state import StonePreview
from rabbit_ros.message_checks import Refused

NEWEST = 20  # of an episode, as many as are latched
EPISODES = 3  # of another one too, for a present episode that was not heard of yet


class PreviewBuffer:
    """By episode and index of the stone."""

    def __init__(self) -> None:
        self._episodes: dict[int, dict[int, StonePreview]] = {}

    def add(self, episode: int, stone: StonePreview, present: int) -> None:
        """Keep a preview while episode `present` is walked.

        Raises:
            Refused: of an episode before it, or other edges than were told before.
        """
        if episode < present:
            raise Refused("late", f"stone {stone.index} of episode {episode}; expected {present} or later")
        stones = self._episodes.setdefault(episode, {})
        before = stones.get(stone.index, stone)
        if before != stone:
            raise Refused("told otherwise", f"{stone} of episode {episode}; it was {before}")
        stones[stone.index] = stone
        if len(stones) > NEWEST:
            del stones[min(stones)]
        while len(self._episodes) > EPISODES:
            wanted = (present, present + 1)
            del self._episodes[min(self._episodes, key=lambda number: (number in wanted, number))]

    def get(self, episode: int, index: int) -> StonePreview | None:
        """The stone with this index; None if it was not heard of."""
        return self._episodes.get(episode, {}).get(index)
