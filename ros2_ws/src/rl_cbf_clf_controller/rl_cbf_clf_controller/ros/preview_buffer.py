"""The previews that were received: one for each stone, of the present episode and of the one that may come next.

By their stamps a foreign copy of another stone's preview is known, see `newest_preview`.
"""

from rabbit_common.message_checks import Refused
from rabbit_description.state import StonePreview, newest_preview

NEWEST = 20  # of an episode, as many as are latched
EPISODES = 3  # of another one too, for a present episode that was not heard of yet
CANDIDATES = 5  # for a stone


class PreviewBuffer:
    """By episode, index of the stone and stamp, ns."""

    def __init__(self) -> None:
        self._episodes: dict[int, dict[int, dict[int, StonePreview]]] = {}
        self._used: tuple[int, StonePreview] | None = None  # by the newest state, with its episode

    def add(self, episode: int, stone: StonePreview, stamp: int, present: int) -> None:
        """Keep a preview while episode `present` is walked.

        Raises:
            Refused: of an episode before it, or other edges than were told before.
        """
        if episode < present:
            raise Refused("late", f"stone {stone.index} of episode {episode}; expected {present} or later")
        stones = self._episodes.setdefault(episode, {})
        candidates = stones.setdefault(stone.index, {})
        before = candidates.get(stamp, stone)
        if before != stone:
            raise Refused("told otherwise", f"{stone} of episode {episode}; it was {before}")
        candidates[stamp] = stone
        if len(candidates) > CANDIDATES:
            del candidates[next(iter(candidates))]
        if len(stones) > NEWEST:
            del stones[min(stones)]
        while len(self._episodes) > EPISODES:
            wanted = (present, present + 1)
            del self._episodes[min(self._episodes, key=lambda number: (number in wanted, number))]

    def get(self, episode: int, index: int, since: int, now: int) -> StonePreview | None:
        """The stone that a state stamped `now` needs, where the last one was stamped `since`; None: not here yet."""
        if self._used is not None and (self._used[0], self._used[1].index) == (episode, index):
            return self._used[1]
        preview = newest_preview(self._episodes.get(episode, {}).get(index, {}), now, since)
        if preview is not None:
            self._used = episode, preview
        return preview
