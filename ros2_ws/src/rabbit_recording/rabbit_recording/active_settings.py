"""Which policy and which settings a controller goes by at a tick, by what it has announced in the recording so far."""

import json
from dataclasses import dataclass
from typing import Any

from rabbit_description.gait import Gaits, parse_gaits
from rl_cbf_clf_controller.parameters import ControllerParameters

Place = tuple[int, int]  # episode, tick


@dataclass(frozen=True)
class RecordedSettings:
    """What the controller went by from the answer to `tick` on."""

    tick: int
    parameters: ControllerParameters
    gait: Gaits


class Settings:
    """The controller's settings, in the order in which it announced them.

    They say from which episode and tick they hold. Those of a controller that was just started say 0: they hold from
    the next episode on. What was announced before cannot hold later than what was announced after.
    """

    def __init__(self) -> None:
        self._announced: list[tuple[Place, Any]] = []

    def add(self, message: Any, newest: Place) -> None:
        """One more, while the newest state was this one."""
        place = (message.episode, message.tick)
        if message.episode == 0 and self._announced:
            episode, tick = newest
            place = (episode + (tick > 0), 0)
        self._announced = [(min(before, place), earlier) for before, earlier in self._announced]
        self._announced.append((place, message))

    def of(self, episode: int) -> list[RecordedSettings]:
        """The settings of an episode, the first from tick 0 on; later only those of later ones can be asked for."""
        before = [i for i, (place, _) in enumerate(self._announced) if place <= (episode, 0)]
        self._announced = self._announced[before[-1] if before else 0 :]
        begin = [self._announced[0][1]] if before else []
        here = [(place[1], message) for place, message in self._announced[len(begin) :] if place[0] == episode]
        return [_settings(tick, message) for tick, message in [*((0, message) for message in begin), *here]]


def _settings(tick: int, message: Any) -> RecordedSettings:
    parameters = ControllerParameters.model_validate_json(message.parameters)
    return RecordedSettings(tick, parameters, parse_gaits(json.loads(message.gait)))


class Policies:
    """The policies that were announced, in their order; one may come twice. A torque names the one that made it."""

    def __init__(self) -> None:
        self._announced: list[tuple[str, bytes]] = []

    def add(self, message: Any) -> None:
        """A `PolicySwap`."""
        if message.accepted:
            self._announced.append((message.version, bytes(message.data)))

    def get(self, version: str) -> bytes | None:
        """The policy's bytes, empty for the built-in zero policy; None if it was not announced."""
        return dict(self._announced).get(version)

    def forget_before(self, version: str) -> None:
        """Drop the policies that were announced before this one: no later episode needs them."""
        first = next((i for i, (announced, _) in enumerate(self._announced) if announced == version), 0)
        del self._announced[:first]
