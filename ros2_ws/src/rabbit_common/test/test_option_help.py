"""What an option's help says of its default, and which default holds."""

import typer
from pydantic import BaseModel, Field
from rabbit_common.options import Defaults, Given, described, options
from typer.testing import CliRunner


class Options(BaseModel):
    """One of each kind."""

    out: str = Field(description="folder")
    jobs: int = Field(default_factory=lambda: 2, description="processes")
    name: str = Field("", description="of the run")
    runs: int = Field(10, description="walks")


def test_a_default_is_named_where_there_is_one_to_name() -> None:
    expected = {"out": "folder", "jobs": "processes", "name": "of the run", "runs": "walks (default: 10)"}
    assert described([Options]) == expected


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


def test_help_leaves_out_what_help_all_shows() -> None:
    app = typer.Typer()

    @app.command()
    @options(Options, Robot, rare=("jobs",))
    def walk(given: Given) -> None:
        """Walk."""

    short, whole = (CliRunner().invoke(app, [word]).output for word in ("--help", "--help-all"))
    usual, others = ("--out", "--name", "--runs", "--controller", "--help-all"), ("--jobs", "--lag", "--scale")
    assert all(name in short for name in usual)
    assert not any(name in short for name in others)
    assert all(name in whole for name in (*usual, *others))
