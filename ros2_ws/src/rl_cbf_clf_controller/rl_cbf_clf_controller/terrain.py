"""What a controller knows of the ground ahead: nothing, or the one stone in sight."""

from dataclasses import dataclass
from typing import Literal

from rabbit_description.state import RobotState, StonePreview

from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.uncertainty import STATE_OBSERVATION

FARTHEST_STONE = 2.0  # m
HIGHEST_STONE = 0.5  # m, up or down


@dataclass(frozen=True)
class Terrain:
    """Flat ground, of which nothing has to be seen, or stones, of which the next one is seen."""

    name: Literal["flat", "stones"]

    def check(self, state: RobotState) -> None:
        """Raises `ControllerError` where a state on stones comes without the next stone's preview."""
        if self.name == "flat":
            return
        stone = state.preview
        if stone is None or stone.index != state.touchdowns + 1:
            raise ControllerError(f"state.preview = {stone}: expected stone {state.touchdowns + 1}")
        if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m")
        if not abs(stone.height) <= HIGHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m")

    def observed(self, stone: StonePreview | None, step_length: tuple[float, ...]) -> int:
        """How many of the observations there are: the robot's; on stones the near edge, and a library's step length."""
        return len(STATE_OBSERVATION) + (1 + len(step_length) if stone and self.name == "stones" else 0)
