"""YAML files that mean the same to every reader; what is in them is not trusted.

YAML 1.1 (PyYAML), YAML 1.2 and ROS read some plain values differently: `0200` is 128 or 200, `yes` is true or text.
Such a value is refused, and so are duplicate keys, anchors, aliases and tags.
"""

import math
import re
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import yaml

from rabbit_description.bounded_file import FileError, read_text
from rabbit_description.validation import one_line

MOST_BYTES = 250_000  # the largest library that is shipped has 47,192
DEEPEST = 20  # lists and mappings in each other
LONGEST_KEY = 100  # characters
SHOWN = 60  # of a wrong value

_LITERALS: dict[str, bool | None] = {"": None, "~": None, "null": None, "Null": None, "NULL": None}
_LITERALS |= {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]{0,18})")
_FLOAT = re.compile(r"[-+]?((\.[0-9]+|(0|[1-9][0-9]*)\.[0-9]*)([eE][-+]?[0-9]+)?|(0|[1-9][0-9]*)[eE][-+]?[0-9]+)")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_ANY_NUMBER = (  # of YAML 1.2 or ROS; PyYAML itself says what it takes for one
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|0o[0-7]+|[-+]?0[xX][0-9a-fA-F.]+([pP][-+]?[0-9]+)?"
)
_DISPUTED = re.compile(rf"[yYnN]|[-+]?(?i:inf|infinity|nan)|{_ANY_NUMBER}")
_TEXT = "tag:yaml.org,2002:str"
_pyyaml = yaml.resolver.Resolver()
_Parser = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast


def read_yaml(path: Path) -> Any:
    """What the file holds: None, text, numbers, lists, and mappings whose keys are text.

    Raises:
        FileError: see `read_text` and `parse_yaml`.
    """
    return parse_yaml(read_text(path, MOST_BYTES))


def read_mapping(path: Path) -> dict[str, Any]:
    """The same of a file of names and values, or an empty one; raises `FileError`."""
    content = read_yaml(path)
    if not isinstance(content, dict | None):
        raise FileError(f"{shortened(content)}: expected names, each with a value")
    return content or {}


def parse_yaml(text: str) -> Any:
    """What a text holds.

    Raises:
        FileError: the text is not YAML, is nested too deep, or has a value that other readers take for something else.
    """
    try:
        events: Iterator[Any] = yaml.parse(text, Loader=_Parser)
        next(events)  # the stream begins
        if isinstance(next(events), yaml.StreamEndEvent):
            return None
        value = _value(events, next(events), "", 0)
        next(events)  # the document ends
        if not isinstance(event := next(events), yaml.StreamEndEvent):
            _refuse(event, "", "a second document: expected one")
        return value
    except (yaml.YAMLError, ValueError) as error:  # the parser raises both
        raise FileError(one_line(error)) from error


def dump_yaml(content: Any, **style: Any) -> str:
    """Plain data as text, the keys in their order: `parse_yaml` finds the same again."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, **style)


def shortened(value: Any) -> str:
    """What an error says of a value, of bounded length."""
    return _cut(reprlib.repr(value))


def _value(events: Iterator[Any], event: Any, place: str, depth: int) -> Any:
    """What begins with `event`; `place` is where it is, as in `stones[0].l_min`."""
    if event.anchor is not None:  # of an alias too
        _refuse(event, place, f"{_cut(event.anchor)}: expected no anchor or alias")
    if event.tag is not None:
        _refuse(event, place, f"{_cut(event.tag)}: expected no tag")
    if depth > DEEPEST:
        _refuse(event, place, f"nested too deep: expected at most {DEEPEST} levels")
    if isinstance(event, yaml.ScalarEvent):
        try:
            return event.value if event.style else _plain(event.value)  # a style: in quotes, or a block
        except ValueError as error:
            _refuse(event, place, f"{_cut(event.value)}: {error}")
    if isinstance(event, yaml.SequenceStartEvent):
        values: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            values.append(_value(events, event, f"{place}[{len(values)}]", depth + 1))
        return values
    mapping: dict[str, Any] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        name = _value(events, event, place, depth) if isinstance(event, yaml.ScalarEvent) else None
        if not isinstance(name, str) or len(name) > LONGEST_KEY:
            _refuse(event, place, f"a key: expected text of at most {LONGEST_KEY} characters")
        inner = f"{place}.{name}" if place else name
        if name in mapping:
            _refuse(event, "", f"key {inner[:LONGEST_KEY]}: expected once")
        mapping[name] = _value(events, next(events), inner, depth + 1)
    return mapping


def _plain(text: str) -> Any:
    """The value of a plain scalar; raises `ValueError` where readers disagree."""
    if text in _LITERALS:
        return _LITERALS[text]
    if _INTEGER.fullmatch(text) and -(2**63) <= int(text) < 2**63:
        return int(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", "", 1))
    if _FLOAT.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    if _DISPUTED.fullmatch(text) or _pyyaml.resolve(yaml.ScalarNode, text, (True, False)) != _TEXT:
        raise ValueError("readers of YAML disagree; expected a decimal number, true or false, or text in quotes")
    return text


def _cut(text: str) -> str:
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def _refuse(event: Any, place: str, text: str) -> NoReturn:
    where = f"{place[:SHOWN]} = " if place else ""
    raise FileError(f"line {event.start_mark.line + 1}: {where}{text}")


class _Dumper(yaml.SafeDumper):
    """Writes no aliases, and in quotes what is text only there."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_text(self, text: str) -> Any:
        try:
            style = None if _plain(text) == text else "'"
        except ValueError:
            style = "'"
        return self.represent_scalar(_TEXT, text, style)


_Dumper.add_representer(str, _Dumper.represent_text)
