"""What a browser may ask of a played walk. Each message is checked by its model, here and nowhere else."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from rabbit_play.settings import Number, PlaySettings

LOAD = b"load "  # not from a browser: the path of a policy that was learned follows


class Message(BaseModel):
    """Exactly these fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Set(Message):
    """Choose settings; those that need it act from the next reset."""

    do: Literal["set"]
    settings: PlaySettings
    reset: bool = False


class Reset(Message):
    """Begin again, with the chosen settings and without pushes."""

    do: Literal["reset"]


class Pause(Message):
    """Hold the walk, or let it go on."""

    do: Literal["pause"]
    paused: bool


class Tick(Message):
    """Hold the walk after one more tick."""

    do: Literal["tick"]


class Speed(Message):
    """Times real time."""

    do: Literal["speed"]
    speed: Number = Field(ge=0.05, le=4)


class PushNow(Message):
    """Push the torsos from the next tick on."""

    do: Literal["push"]
    force: Number = Field(ge=-1000, le=1000)
    seconds: Number = Field(0.1, ge=0.001, le=1)


Asked = Annotated[Set | Reset | Pause | Tick | Speed | PushNow, Field(discriminator="do")]
ASKED: TypeAdapter[Asked] = TypeAdapter(Asked)
