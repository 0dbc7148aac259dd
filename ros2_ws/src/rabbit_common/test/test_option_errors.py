"""The line that a wrong value ends a command with: option, value, and what was expected, said once."""

from typing import Annotated

import pytest
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from rabbit_common.options import fault


def known_colour(value: object) -> object:
    """A validator as the packages write them."""
    if value not in ("red", "green"):
        raise ValueError("expected 'red' or 'green'")
    return value


class Part(BaseModel):
    """With what can be wrong."""

    model_config = ConfigDict(extra="forbid")

    colour: Annotated[str, BeforeValidator(known_colour)] = "red"
    mass_scale: float = Field(1.0, gt=0)
    length: float = 1.0

    @model_validator(mode="after")
    def _fits(self) -> "Part":
        if self.length > self.mass_scale:
            raise ValueError(f"length = {self.length:g}: expected at most mass_scale = {self.mass_scale:g}")
        return self


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"colour": "blue"}, "--colour blue: expected 'red' or 'green'"),
        ({"mass_scale": 0}, "--mass-scale 0: expected greater than 0"),
        ({"mass_scale": "heavy"}, "--mass-scale heavy: expected number, unable to parse string as a number"),
        ({"length": 2.0}, "length = 2: expected at most mass_scale = 1"),
        ({"width": 2.0}, "width: no such parameter"),
        ("text", "expected names, each with a value"),
        (["a"], "expected names, each with a value"),
    ],
)
def test_a_wrong_value_is_told_in_one_sentence(given: object, said: str) -> None:
    with pytest.raises(ValidationError) as error:
        Part.model_validate(given)
    assert fault(error.value) == said
