"""What a browser may ask of what is played. Each message is checked by its model, its settings by the `Door`."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter
from rabbit_description.validation import Checked

from rabbit_viewer.page import Explain
from rabbit_viewer.play.settings import Number


class Choose(Checked):
    """Choose settings, of which some act from the next reset; or begin again with them."""

    do: Literal["set", "begin"]
    settings: dict[str, Any]


class Do(Checked):
    """Begin again as chosen; pause after one more tick; somebody looks, for whom what is played has waited."""

    do: Literal["reset", "tick", "watch"]


class Pause(Checked):
    """Hold what is played, or let it go on."""

    do: Literal["pause"]
    paused: bool


class Speed(Checked):
    """Times real time."""

    do: Literal["speed"]
    speed: Number = Field(ge=0.05, le=4)


class Push(Checked):
    """Push the torsos from the next tick on."""

    do: Literal["push"]
    force: Number = Field(ge=-1000, le=1000)
    seconds: Number = Field(0.1, ge=0.001, le=1)


Asked = Annotated[Choose | Do | Pause | Speed | Push | Explain, Field(discriminator="do")]
ASKED: TypeAdapter[Asked] = TypeAdapter(Asked)


@dataclass(frozen=True)
class Learned:
    """The file of a policy that was learned next to the walk; it comes from no browser."""

    path: str
