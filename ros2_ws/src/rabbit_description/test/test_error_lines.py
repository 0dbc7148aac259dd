"""An error is one line: of a person's own code with file and line, of a value with its name and what was expected."""

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from rabbit_description.user_code import fault_in_user_code, plugged
from rabbit_description.validation import nearest, one_line, one_of


def error_of(path: Path, text: str, names: dict[str, object] | None = None) -> Exception:
    """What a file of this text raises."""
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_text(text)
    with pytest.raises(Exception) as raised:  # noqa: PT011  any
        exec(compile(text, str(path), "exec"), names or {"__name__": path.stem})
    error = raised.value
    assert error.__traceback__
    error.__traceback__ = error.__traceback__.tb_next  # without this test, which is a person's file too
    return error


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\ny = x / 0\n", "line 2: ZeroDivisionError: division by zero: `y = x / 0`"),
        ("\nx = casadi.SX()\n", "line 2: NameError: name 'casadi' is not defined: `x = casadi.SX()`"),
        (
            "import nosuch_library\n",
            "line 1: ModuleNotFoundError: No module named 'nosuch_library': `import nosuch_library`",
        ),
        ("def f():\n    return {}['a']\nf()\n", "line 2: KeyError: 'a': `return {}['a']`"),
        ("import json\njson.loads('{')\n", "line 2: JSONDecodeError: Expecting property name"),  # raised in a library
        ("x = (\n", "line 1: SyntaxError: '(' was never closed: `x = (`"),
    ],
)
def test_file_line_and_source_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.py"
    found = fault_in_user_code(error_of(path, text))
    assert found is not None
    assert found.startswith(f"{path}, {said}")
    assert "\n" not in found


def test_libraries_and_the_project_are_nobodys_own_code_but_a_plugin_among_the_libraries_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match="Expecting") as raised:
        json.loads("{")
    error = raised.value
    assert error.__traceback__
    error.__traceback__ = error.__traceback__.tb_next
    assert fault_in_user_code(error) is None
    assert fault_in_user_code(error_of(tmp_path / "ours.py", "1 / 0\n", {"__name__": "rabbit_sim.plant"})) is None
    installed = error_of(tmp_path / "site-packages" / "other.py", "1 / 0\n")
    assert fault_in_user_code(installed) is None
    monkeypatch.setattr("rabbit_description.user_code.plugged", plugged | {"other"})
    assert "other.py, line 1: ZeroDivisionError" in str(fault_in_user_code(installed))


def test_the_nearest_name_comes_first() -> None:
    assert one_of("bset", ["authors", "ours", "best"]) == "one of best, authors, ours (did you mean best?)"
    assert one_of("zzz", ["authors", "ours"]) == "one of authors, ours"
    assert nearest("zzz", ["authors"]) == ""


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
