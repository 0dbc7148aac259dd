"""The states of N robots at one tick, in rows: what `RobotState` has of one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rabbit_description.state import Array, RobotState, StonePreview


@dataclass
class RobotStates:
    """See `RobotState`: `tick`, `touchdowns`, `running` (N,); `q`, `dq` (N, 7); `foot_force` (N, 2, 2); `contact`
    (N, 2); `applied` (N, 4).

    `stones` (N, 3): l_min, l_max and height of the previews, NaN without one; `previews` are these objects.
    """

    tick: Array
    q: Array
    dq: Array
    foot_force: Array
    contact: Array
    touchdowns: Array
    running: Array
    applied: Array
    stones: Array
    previews: list[StonePreview | None]

    @classmethod
    def of(cls, states: Sequence[RobotState]) -> "RobotStates":
        """Puts the states of single robots into rows."""
        arrays = {name: np.array([getattr(state, name) for state in states]) for name in ARRAYS}
        rows = cls(**arrays, stones=np.full((len(states), 3), np.nan), previews=[None] * len(states))
        for i, state in enumerate(states):
            rows.see(i, state.preview)
        return rows

    def __len__(self) -> int:
        return len(self.tick)

    def __getitem__(self, i: int) -> RobotState:
        """The state of robot `i`; its arrays are views."""
        values = {name: getattr(self, name)[i] for name in ARRAYS}
        values |= {"tick": int(self.tick[i]), "touchdowns": int(self.touchdowns[i]), "running": bool(self.running[i])}
        return RobotState(**values, preview=self.previews[i])

    def __setitem__(self, i: int, state: RobotState) -> None:
        for name in ARRAYS:
            getattr(self, name)[i] = getattr(state, name)
        self.see(i, state.preview)

    def see(self, i: int, stone: StonePreview | None) -> None:
        """The preview that robot `i` has."""
        self.previews[i] = stone
        self.stones[i] = (np.nan,) * 3 if stone is None else (stone.l_min, stone.l_max, stone.height)

    def kept(self, rows: Array) -> "RobotStates":
        """The states of some robots, by number."""
        arrays = {name: getattr(self, name)[rows] for name in (*ARRAYS, "stones")}
        return RobotStates(**arrays, previews=[self.previews[i] for i in rows])


ARRAYS = ("tick", "q", "dq", "foot_force", "contact", "touchdowns", "running", "applied")
