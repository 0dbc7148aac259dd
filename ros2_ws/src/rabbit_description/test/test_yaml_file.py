"""YAML files: what all readers read alike is taken, all else is refused in one short line."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.bounded_file import FileError
from rabbit_description.yaml_file import dump_yaml, parse_yaml, read_yaml

ALIKE = {
    **{"7": 7, "-3": -3, "+5": 5, "0": 0, "9223372036854775807": 2**63 - 1},
    **{"0.5": 0.5, ".5": 0.5, "5.": 5.0, "1e3": 1000.0, "-1.5E-3": -0.0015, ".inf": math.inf},
    **{
        "true": True,
        "False": False,
        "null": None,
        "~": None,
        "stones": "stones",
        "89ac228": "89ac228",
        "1.2.3": "1.2.3",
    },
    **{"'0200'": "0200", '"yes"': "yes", "[1, 2]": [1, 2], "{b: {c: 1}}": {"b": {"c": 1}}},
}
DISPUTED = ("0200", "08", "0o17", "0x10", "0b1", "1_000", "3:20", "1:30.5", "9223372036854775808", "1e999", "00.5")
DISPUTED += ("yes", "No", "on", "OFF", "y", "N", "inf", "-Infinity", "nan", "2001-01-01", "=", "<<")


@pytest.mark.parametrize("text", DISPUTED)
def test_what_readers_read_differently_is_refused_with_line_key_and_value(text: str) -> None:
    with pytest.raises(FileError) as refused:
        parse_yaml(f"a: 1\nb:\n  - c: {text}\n")
    assert str(refused.value).startswith(f"line 3: b[0].c = {text}: readers of YAML disagree")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2", "line 2: key a: expected once"),
        ("a: &x 1", "line 1: a = x: expected no anchor or alias"),
        ("a: !!python/name:os.system", "expected no tag"),
        ("? [a]\n: 1", "line 1: a key: expected text"),
        ("a: 1\n---\na: 2", "line 2: a second document"),
        ("a: \x00", "control characters are not allowed"),
    ],
)
def test_what_no_file_needs_is_refused(text: str, said: str) -> None:
    with pytest.raises(FileError) as refused:
        parse_yaml(text)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("path", [*GAITS.glob("*.yaml"), *LIBRARIES.glob("*.yaml")], ids=lambda path: path.stem)
def test_the_shipped_files_mean_what_pyyaml_reads(path: Path) -> None:
    assert read_yaml(path) == yaml.safe_load(path.read_text(encoding="utf-8"))


texts = st.text(max_size=12) | st.sampled_from([*DISPUTED, *ALIKE])
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | texts
trees = st.recursive(scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4))


@settings(deadline=None)
@given(trees)
def test_what_is_written_is_read_again_by_us_and_by_pyyaml(tree: Any) -> None:
    text = dump_yaml({"a": tree})
    assert parse_yaml(text) == {"a": tree}
    assert yaml.safe_load(text) == {"a": tree}


@settings(deadline=None)
@given(st.text(alphabet="0123456789abcdefxoynYN_:.+-eE<=~ ", max_size=8))
def test_what_is_taken_is_what_pyyaml_reads(text: str) -> None:
    """But a number such as 1e3, which PyYAML alone takes for text."""
    try:
        found = parse_yaml(f"a: {text}")
    except FileError:
        return
    by_pyyaml = yaml.safe_load(f"a: {text}")
    if isinstance(found, dict) and isinstance(found["a"], float) and isinstance(by_pyyaml["a"], str):
        by_pyyaml["a"] = float(by_pyyaml["a"])
    assert found == by_pyyaml
