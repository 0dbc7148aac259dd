"""What a node, or a command that joins the graph, says of an environment or an argument that cannot be used."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rabbit_bringup.launching.parameter_file import ParameterFileError, read_parameters
from rclpy.signals import SignalHandlerOptions

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
RECORDER = ("run", "rabbit_recording", "recorder")


def last_line(*words: str, **environment: str | None) -> tuple[int, str]:
    """Exit code and last line of a command; an environment's name with None is left out."""
    merged = {**os.environ, **environment}
    kept = {name: value for name, value in merged.items() if value is not None}
    done = subprocess.run([*RABBIT, *words], capture_output=True, text=True, timeout=180, check=False, env=kept)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-r", "foo"), "remap rule: '-r foo'"),
        (("--params-file", "/nowhere.yaml"), "/nowhere.yaml"),
        (("-p", "path"), "'-p path'"),
        (("--bogus",), "unknown ROS arguments ['--bogus']"),
        (("--log-level", "loud"), "--log-level loud"),
    ],
)
def test_a_node_refuses_a_wrong_argument_in_one_line(words: tuple[str, ...], said: str) -> None:
    code, line = last_line(*RECORDER, "--ros-args", *words)
    assert code == 2
    assert line.startswith("error: ")
    assert said in line
    assert "/src/" not in line  # where in ROS's sources


@pytest.mark.parametrize(
    "words",
    [RECORDER, ("view",), ("walk", "--out"), ("policy", "load", "rl-cbf-clf-qp")],
    ids=lambda words: words[0],
)
def test_a_domain_that_is_none_is_refused_by_all(words: tuple[str, ...], tmp_path: Path) -> None:
    if words[-1] == "--out":
        words = (*words, str(tmp_path / "walk"))
    code, line = last_line(*words, ROS_DOMAIN_ID="abc")
    assert code == 2
    assert line.endswith("ROS_DOMAIN_ID abc: expected a whole number from 0 to 232")
    assert not (tmp_path / "walk").exists()


def test_without_a_home_a_node_says_so() -> None:
    code, line = last_line(*RECORDER, HOME=None, ROS_HOME=None, ROS_LOG_DIR=None)
    assert code == 2
    assert "HOME" in line


PATTERNS = """
/**: {ros__parameters: {a: 1, nested: {deep: 2}}}
/**/simulator: {ros__parameters: {a: 2}}
simulator: {ros__parameters: {a: 3}}
left:
  simulator: {ros__parameters: {b: 4}}
  "*": {ros__parameters: {c: 5}}
/left/inner/simulator: {ros__parameters: {a: 6}}
/*/simulator: {ros__parameters: {d: 7}}
/**/controller: {ros__parameters: {a: 8}}
"""


def by_ros(file: Path, name: str, namespace: str = "") -> dict[str, Any]:
    """The parameters that ROS gives to a node."""
    context = rclpy.Context()
    words = ["--ros-args", "--params-file", str(file)]
    rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(
            name, namespace=namespace, context=context, automatically_declare_parameters_from_overrides=True
        )
        return {key: parameter.value for key, parameter in node._parameter_overrides.items()}
    finally:
        rclpy.try_shutdown(context=context)


@pytest.mark.parametrize("namespace", ["", "left", "/left", "left/inner", "right"])
@pytest.mark.parametrize("name", ["simulator", "controller"])
def test_a_parameter_file_says_to_a_node_what_it_says_in_ros(namespace: str, name: str, tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(PATTERNS)
    assert read_parameters(file, namespace, (name,))[name] == by_ros(file, name, namespace)


ALIKE = ("7", "-3", "0.5", ".5", "5.", "1e3", "1.5e-3", ".inf", "true", "False", "word", "'0200'", '"yes"', "1.2.3")
OTHERWISE = ("0200", "08", "0x10", "1_000", "3:20", "yes", "on", "y", "N", "inf", "null", "~", "9223372036854775808")


@pytest.mark.parametrize("value", [*ALIKE, *OTHERWISE])
def test_a_value_is_read_as_in_ros_or_refused(value: str, tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(f"simulator: {{ros__parameters: {{a: {value}}}}}")
    if value in OTHERWISE:
        with pytest.raises(ParameterFileError, match=r"parameters\.yaml: .*a"):
            read_parameters(file, "", ("simulator",))
    else:
        (ours,), (theirs,) = (
            found.values()
            for found in (read_parameters(file, "", ("simulator",))["simulator"], by_ros(file, "simulator"))
        )
        assert (ours, type(ours)) == (theirs, type(theirs))


@pytest.mark.parametrize("text", ["a: [", "- 1", "simulator: 3", "ros__parameters: {a: 1}", "a: {ros__parameters: 3}"])
def test_what_is_no_parameter_file_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(text)
    with pytest.raises(ParameterFileError, match=str(file)):
        read_parameters(file, "", ("simulator",))
