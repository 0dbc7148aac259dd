"""What is wrong with a value or a file, in one line: its name, what it is, what was expected."""

import re
from collections.abc import Callable, Collection
from difflib import get_close_matches

from pydantic import BaseModel, ConfigDict, ValidationError

LONGEST_LINE = 1000  # characters of an error


class Checked(BaseModel):
    """Has exactly its fields, which do not change. It is built when it is first used: `--help` needs none."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def one_line(error: object, most: int = LONGEST_LINE) -> str:
    """What an error says, in one line of at most `most` characters; of pydantic's the first fault."""
    text = " ".join((fault(error) if isinstance(error, ValidationError) else str(error)).split())
    return text if len(text) <= most else f"{text[:most]} ..."


def nearest(name: object, known: Collection[str]) -> str:
    """The known name that was probably meant; empty where none is near."""
    return next(iter(get_close_matches(str(name), known, n=1)), "")


def one_of(name: object, known: Collection[str]) -> str:
    """What was expected in place of a name that is not known: all names, the nearest one first."""
    near = nearest(name, known)
    names = ", ".join(sorted(known, key=lambda name: name != near))
    return f"one of {names} (did you mean {near}?)" if near else f"one of {names}"


def fault(error: ValidationError, named: Callable[[str], str] = str, equals: str = " = ") -> str:
    """Name, value and expectation of the first thing that is wrong, an unknown name before all others."""
    first = min(error.errors(), key=lambda entry: entry["type"] != "extra_forbidden")
    text = re.sub(r"^(Input should be|Value error,)( a valid)? ?(expected )?", "", first["msg"])
    if first["type"] == "literal_error":
        known = re.findall(r"'([^']*)'", str(first.get("ctx", {}).get("expected", "")))
        text = one_of(first["input"], known) if known else text
    is_mapping = first["type"] == "model_type"
    text = "names, each with a value" if is_mapping else text
    if not first["loc"]:
        return f"expected {text}" if is_mapping else first["msg"].removeprefix("Value error, ")
    place, *inside = first["loc"]
    parts = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in inside)
    if first["type"] == "extra_forbidden":
        return f"{place}{parts}: no such parameter"
    name = f"{named(str(place))}{parts}"
    return f"{name}: missing" if first["type"] == "missing" else f"{name}{equals}{first['input']}: expected {text}"
