"""What a controller knows of the ground ahead: nothing, or the one stone in sight."""

from typing import Any, Literal

from rabbit_description.state import RobotState, StonePreview

from rl_cbf_clf_controller.scene import ControllerError

FARTHEST_STONE = 2.0  # m
HIGHEST_STONE = 0.5  # m, up or down
OF_STATE = 14  # observations of the robot itself


class FlatGround:
    """Nothing has to be seen of it. `parameters` are the `ControllerParameters`."""

    name: Literal["flat", "stones"] = "flat"

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def check(self, state: RobotState) -> None:
        """Any state will do."""

    def observed(self, stone: StonePreview | None, step_length: tuple[float, ...]) -> int:
        """How many of the observations there are: those of the robot."""
        return OF_STATE


class SteppingStones(FlatGround):
    """One stone is seen at a time, the next."""

    name = "stones"

    def check(self, state: RobotState) -> None:
        """Raises `ControllerError` where the state comes without the next stone's preview."""
        stone = state.preview
        if stone is None or stone.index != state.touchdowns + 1:
            raise ControllerError(f"state.preview = {stone}: expected stone {state.touchdowns + 1}")
        if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m")
        if not abs(stone.height) <= HIGHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m")

    def observed(self, stone: StonePreview | None, step_length: tuple[float, ...]) -> int:
        """With the near edge, m, and the `step_length` that a gait library chose for the stone."""
        return OF_STATE + (1 + len(step_length) if stone else 0)
