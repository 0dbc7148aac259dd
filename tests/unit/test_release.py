"""What a release says of itself is the same in every file, and what it promises is there."""

import configparser
import importlib
import inspect
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rabbit_common.ros.topics import SERVICES, TOPICS

ROOT = Path(__file__).resolve().parents[2]
MANIFESTS = [ElementTree.parse(path).getroot() for path in sorted(ROOT.glob("ros2_ws/src/*/package.xml"))]


def test_one_version_everywhere() -> None:
    """RELEASE.md says how it is changed."""
    files = [*ROOT.glob("ros2_ws/src/*/setup.cfg"), ROOT / "studies/pyproject.toml", ROOT / "qa/pyproject.toml"]
    said = re.compile(r'^(?:version = "?| +(?:cbf|rabbit|rl)_\w+==)([\w.]+)', re.MULTILINE)
    versions = {(path, version) for path in files for version in said.findall(path.read_text(encoding="utf-8"))}
    assert {path for path, _ in versions} == {*files}
    versions |= {("package.xml", manifest.findtext("version")) for manifest in MANIFESTS}
    page = (ROOT / "studies/docs/reproduce.md").read_text(encoding="utf-8")
    versions |= {("reproduce.md", version) for version in re.findall(r"version = \{(.*)\}", page)}
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"]
    assert {version for _, version in versions} == {cited}


def test_keys_of_pip_are_those_of_the_page() -> None:
    """That rosdep knows each key, its own command says in CI."""
    page = (ROOT / "docs/ros_conventions.md").read_text(encoding="utf-8").split("## Keys of pip")[1].split("\n## ")[0]
    keys = {key.text for manifest in MANIFESTS for key in manifest.iter("exec_depend")}
    text = "".join(path.read_text(encoding="utf-8") for path in ROOT.glob("ros2_ws/src/*/package.xml"))
    without = set(re.findall("<!-- without a rosdep key: (.*) -->", text))
    assert {*re.findall("`([a-z0-9-]+)`", page)} == {key for key in keys if key.endswith("-pip")} | without


PROMISED = (ROOT / "docs/reference/promised.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """Of the page of what is promised, with one space where its lines end."""
    return " ".join(PROMISED.split(f"## {title}\n")[1].split("\n## ")[0].split())


@pytest.mark.parametrize("name", re.findall(r"`([\w.]+)`", section("Python").split("In Gymnasium")[0]))
def test_what_is_promised_can_be_imported_and_says_what_it_is(name: str) -> None:
    module, _, word = name.rpartition(".")
    assert importlib.import_module(module).__doc__
    value = getattr(importlib.import_module(module), word)
    if inspect.isclass(value) or inspect.isfunction(value):
        said = vars(value).get("__doc__") or "" if inspect.isclass(value) else value.__doc__ or ""
        assert said
        assert not said.startswith(f"{word}(")  # as a dataclass writes by itself


def test_every_command_topic_and_service_is_promised() -> None:
    commands: set[str] = set()
    for path in ROOT.glob("ros2_ws/src/*/setup.cfg"):
        setup = configparser.ConfigParser()
        setup.read(path)
        lines = setup.get("options.entry_points", "rabbit.commands", fallback="")
        commands |= set(re.findall(r"^(\w+) =", lines, re.MULTILINE))
    assert {*re.findall(r"`rabbit (\w+)`", section("Commands"))} == commands
    assert {*re.findall(r"`(\w+)`", section("Topics and services"))} == {offer.name for offer in (*TOPICS, *SERVICES)}


def test_every_promised_group_of_entry_points_is_read() -> None:
    files = (path for folder in ("ros2_ws/src", "studies") for path in (ROOT / folder).rglob("*.py"))
    code = "".join(path.read_text(encoding="utf-8") for path in files)
    groups = re.findall(r"`(rabbit\.\w+)`", section("Entry points"))
    assert groups
    assert [group for group in groups if f'"{group}"' not in code] == []
