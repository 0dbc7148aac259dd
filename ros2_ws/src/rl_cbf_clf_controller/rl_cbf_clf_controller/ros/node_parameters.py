"""The parameters of the controller's node besides the controller's."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

ZERO = "zero"


class NodeParameters(BaseModel):
    """Which policies the node walks with, and its priority."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    policy: str = Field(ZERO, description="policy to begin with: zero, the name of a shipped one, or a file")
    swap_at: Literal["tick", "episode", "never"] = Field(
        "tick",
        description="when published policies take effect; with never they are not heard; "
        "one loaded by service always does at the next tick",
    )
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")
