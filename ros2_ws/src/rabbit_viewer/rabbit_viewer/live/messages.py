"""What a browser may ask of a running graph, where the viewer passes it on."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from rabbit_common.options import fault

from rabbit_viewer.page.server import refused


class Message(BaseModel):
    """Exactly these fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @property
    def request(self) -> dict[str, Any]:
        """The fields of the service's request."""
        return self.model_dump(exclude={"do"}, by_alias=True)


class Pause(Message):
    """Hold the robot between two ticks, or let it go on."""

    do: Literal["pause"]
    paused: bool = Field(serialization_alias="data")


class Reset(Message):
    """End the episode and begin the next one."""

    do: Literal["reset"]
    seed: int = Field(ge=0, le=2**53)


class Load(Message):
    """Put a policy in force: a shipped one, or a file of the controller's machine."""

    do: Literal["load"]
    path: str = Field(min_length=1, max_length=500, serialization_alias="policy")


Asked = Annotated[Pause | Reset | Load, Field(discriminator="do")]
ASKED: TypeAdapter[Asked] = TypeAdapter(Asked)


def checked(message: str) -> Asked | str:
    """The message, or one line that says why it is refused."""
    try:
        return ASKED.validate_json(message)
    except ValidationError as error:
        return refused(fault(error))
