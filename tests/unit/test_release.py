"""What a release says of itself is the same in every file."""

import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parents[2]
MANIFESTS = [ElementTree.parse(path).getroot() for path in sorted(ROOT.glob("ros2_ws/src/*/package.xml"))]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_one_version_everywhere() -> None:
    """RELEASE.md says how it is changed."""
    files = [*ROOT.glob("ros2_ws/src/*/setup.cfg"), ROOT / "studies/pyproject.toml", ROOT / "qa/pyproject.toml"]
    said = re.compile(r'^(?:version = "?| +(?:cbf|rabbit|rl)_\w+==)([\w.]+)', re.MULTILINE)
    versions = {(path, version) for path in files for version in said.findall(path.read_text(encoding="utf-8"))}
    assert {path for path, _ in versions} == {*files}
    versions |= {("package.xml", manifest.findtext("version")) for manifest in MANIFESTS}
    page = (ROOT / "studies/docs/reproduce.md").read_text(encoding="utf-8")
    versions |= {("reproduce.md", version) for version in re.findall(r"version = \{(.*)\}", page)}
    assert {version for _, version in versions} == {CITATION["version"]}


def test_the_author_of_each_package_is_who_is_cited() -> None:
    (author,) = CITATION["authors"]
    assert {manifest.findtext("author") for manifest in MANIFESTS} == {author["name"]}


def test_keys_of_pip_are_those_of_the_page() -> None:
    """That rosdep knows each key, its own command says in CI."""
    page = (ROOT / "docs/ros_conventions.md").read_text(encoding="utf-8").split("## Keys of pip")[1].split("\n## ")[0]
    keys = {key.text for manifest in MANIFESTS for key in manifest.iter("exec_depend")}
    text = "".join(path.read_text(encoding="utf-8") for path in ROOT.glob("ros2_ws/src/*/package.xml"))
    without = set(re.findall("<!-- without a rosdep key: (.*) -->", text))
    assert {*re.findall("`([a-z0-9-]+)`", page)} == {key for key in keys if key.endswith("-pip")} | without
