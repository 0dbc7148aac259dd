"""What a controller knows of the ground ahead: nothing, or the one stone in sight, as barriers and observations."""

from dataclasses import replace
from typing import Any, Literal

from cbf_clf_qp.ecbf import Barriers
from rabbit_description.state import RobotState, StonePreview

from rl_cbf_clf_controller.pinned_robot import Kinematics
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.stone_barriers import stone_barriers

FARTHEST_STONE = 2.0  # m
HIGHEST_STONE = 0.5  # m, up or down


class FlatGround:
    """Nothing has to be seen of it. `parameters` are the `ControllerParameters`."""

    name: Literal["flat", "stones"] = "flat"

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def check(self, state: RobotState) -> None:
        """Any state will do."""

    def barriers(self, feet: Kinematics, stone: StonePreview | None) -> Barriers | None:
        """None."""

    def observed(self, stone: StonePreview | None, step_length: tuple[float, ...]) -> tuple[float, ...]:
        """Nothing."""
        return ()


class SteppingStones(FlatGround):
    """One stone is seen at a time, the next."""

    name = "stones"

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        self._radii = parameters.R1, parameters.R2

    def check(self, state: RobotState) -> None:
        """Raises `ControllerError` where the state comes without the next stone's preview."""
        stone = state.preview
        if stone is None or stone.index != state.touchdowns + 1:
            raise ControllerError(f"state.preview = {stone}: expected stone {state.touchdowns + 1}")
        if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m")
        if not abs(stone.height) <= HIGHEST_STONE:
            raise ControllerError(f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m")

    def barriers(self, feet: Kinematics, stone: StonePreview | None) -> Barriers | None:
        """Of the stone less the margin at both edges; None where no stone is seen."""
        if stone is None:
            return None
        margin = self._parameters.stone_margin
        narrowed = replace(stone, l_min=stone.l_min + margin, l_max=stone.l_max - margin)
        return stone_barriers(feet, narrowed, *self._radii)

    def observed(self, stone: StonePreview | None, step_length: tuple[float, ...]) -> tuple[float, ...]:
        """What a policy reads of it: the near edge, m, then the `step_length` that a gait library chose for it."""
        return (stone.l_min, *step_length) if stone else ()
