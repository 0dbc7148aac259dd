"""What an option's help says of its default, and which default holds; the exit code of several episodes."""

import pytest
from pydantic import BaseModel, Field
from rabbit_common.exit_codes import ExitCode, of_walk
from rabbit_common.options import Defaults, Given, described


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        (["walked"], ExitCode.WALKED),
        (["walked", "fall", "walked"], ExitCode.FELL),
        (["silent", "fall", "walked"], ExitCode.FAULT),
        (["reset", "walked"], ExitCode.WALKED),  # an operator asked for the second
        (["reset", "miss"], ExitCode.FELL),
        (["walked", "reset"], ExitCode.FAULT),  # nothing followed it
        ([], ExitCode.FAULT),
    ],
)
def test_the_worst_episode_counts(outcomes: list[str], code: ExitCode) -> None:
    assert of_walk(outcomes) is code


class Robot(BaseModel):
    """What a command has defaults of its own for."""

    controller: str = Field("nominal", description="which")
    lag: float = Field(0.0, description="s")
    scale: float = Field(1.0, description="of the mass")


OWN = Defaults(always={"lag": 0.004}, bare={"controller": "learned", "scale": 2.0})


def test_a_commands_own_defaults_are_those_that_its_help_names() -> None:
    assert described([Robot], OWN) == {
        "controller": "which (default: learned)",
        "lag": "s (default: 0.004)",
        "scale": "of the mass (default: 2.0; 1.0 with --controller or --parameters)",
    }
    assert Given({}, OWN).build(Robot) == Robot(controller="learned", lag=0.004, scale=2.0)
    assert Given({"controller": "other"}, OWN).build(Robot) == Robot(controller="other", lag=0.004, scale=1.0)
    assert Given({"lag": "0", "scale": "3"}, OWN).build(Robot) == Robot(controller="learned", lag=0.0, scale=3.0)


def test_what_a_file_says_counts_beneath_what_is_given() -> None:
    given = Given({"scale": "3"}, OWN).over({"controller": "other", "scale": 4.0})
    assert given.build(Robot) == Robot(controller="other", lag=0.004, scale=3.0)


def test_what_was_typed_can_be_typed_again() -> None:
    given = Given({"scale": "3", "lag": "0.1", "browser": False, "learn": True, "course": "my stones.csv"})
    assert given.typed(but=("scale",)) == "--no-browser --course 'my stones.csv' --lag 0.1 --learn"
