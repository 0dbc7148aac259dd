"""What a browser may ask of any walk whose ticks are kept."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Explain(BaseModel):
    """Say why a robot decided so in a tick."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    do: Literal["explain"]
    walker: int = Field(ge=0, le=1)
    tick: int = Field(ge=0, le=2**31 - 1)
