"""A value that pydantic refused is told in one line: its name, its value, what was expected."""

from typing import Any

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rabbit_description.validation import one_line


class Part(BaseModel):
    """With what can be wrong."""

    model_config = ConfigDict(extra="forbid")

    mass: float = Field(gt=0)
    links: dict[str, int] = {}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "mass: missing"),
        ({"mass": -1, "links": {"a": "b"}}, "mass = -1: expected greater than 0"),
        ({"mass": 1, "links": {"a": "b"}}, "links.a = b: expected integer, unable to parse string as an integer"),
        ({"width": 2}, "width: no such parameter"),
        (None, "expected names, each with a value"),
    ],
)
def test_one_line_of_a_refused_value(given: Any, said: str) -> None:
    with pytest.raises(ValidationError) as error:
        Part.model_validate(given)
    assert one_line(error.value) == said


def test_a_long_error_is_cut() -> None:
    assert one_line("a\nb" * 1000, 4) == "a ba ..."
