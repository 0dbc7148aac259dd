"""What an option's help says of its default."""

from pydantic import BaseModel, Field
from rabbit_cli.options import described


class Options(BaseModel):
    """One of each kind."""

    out: str = Field(description="folder")
    jobs: int = Field(default_factory=lambda: 2, description="processes")
    name: str = Field("", description="of the run")
    runs: int = Field(10, description="walks")


def test_a_default_is_named_where_there_is_one_to_name() -> None:
    expected = {"out": "folder", "jobs": "processes", "name": "of the run", "runs": "walks (default 10)"}
    assert described([Options]) == expected
