"""What `make test` leaves to `make test-all` is there under its name."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]


@pytest.mark.parametrize("name", OPTIONS["thorough"])
def test_each_name_begins_that_of_a_test(name: str) -> None:
    path, _, test = name.removeprefix("!").partition("[")[0].partition("::")
    assert (ROOT / path).exists()
    if test:
        assert f"def {test}" in (ROOT / path).read_text(encoding="utf-8")
