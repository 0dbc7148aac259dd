"""The README's example runs as it stands there, and what it says of the wall is so."""

import re
from pathlib import Path
from typing import Any

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
(EXAMPLE,) = re.findall(r"```python\n(.+?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def run(code: str) -> dict[str, Any]:
    """The example's names when it has ended."""
    names: dict[str, Any] = {"__name__": "readme"}
    exec(compile(code, str(README), "exec"), names)  # noqa: S102: our own text
    return names


def test_the_cart_stays_before_the_wall() -> None:
    names = run(EXAMPLE)
    assert 0.85 < names["x"][0] <= names["WALL"] + 1e-5  # the force is held for a tick


def test_without_the_wall_it_goes_to_the_goal() -> None:
    names = run(EXAMPLE.replace(", Wall((8.0, 8.0), rescue_weight=1e6))", ",)"))
    assert names["x"][0] == pytest.approx(names["GOAL"], abs=1e-3)
