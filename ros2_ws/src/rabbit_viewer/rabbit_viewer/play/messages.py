"""What a browser may ask of a played walk. Each message is checked by its model, here and nowhere else."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from rabbit_viewer.page.messages import Explain
from rabbit_viewer.play.settings import Checked, Number, PlaySettings


class Set(Checked):
    """Choose settings; those that need it act from the next reset."""

    do: Literal["set"]
    settings: PlaySettings


class Reset(Checked):
    """Begin again, with the chosen settings."""

    do: Literal["reset"]


class Begin(Checked):
    """Begin again with these settings."""

    do: Literal["begin"]
    settings: PlaySettings


class Pause(Checked):
    """Hold the walk, or let it go on."""

    do: Literal["pause"]
    paused: bool


class Tick(Checked):
    """Hold the walk after one more tick."""

    do: Literal["tick"]


class Speed(Checked):
    """Times real time."""

    do: Literal["speed"]
    speed: Number = Field(ge=0.05, le=4)


class Push(Checked):
    """Push the torsos from the next tick on."""

    do: Literal["push"]
    force: Number = Field(ge=-1000, le=1000)
    seconds: Number = Field(0.1, ge=0.001, le=1)


class Watch(Checked):
    """Somebody looks: the walk that waits for its first viewer begins."""

    do: Literal["watch"]


Asked = Annotated[Set | Reset | Begin | Pause | Tick | Speed | Push | Watch | Explain, Field(discriminator="do")]
ASKED: TypeAdapter[Asked] = TypeAdapter(Asked)


@dataclass(frozen=True)
class Learned:
    """Not from a browser: the file of a policy that was learned next to the walk."""

    path: str
