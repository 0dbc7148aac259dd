"""docs/topics.md, the parameter files and the nodes say the same."""

import inspect
import re
from pathlib import Path

import yaml
from rabbit_common.ros.topics import TOPICS
from rclpy.node import Node

ROOT = Path(__file__).parents[2]
BRINGUP = ROOT / "ros2_ws" / "src" / "rabbit_bringup"


def test_rosbag2_is_told_how_to_keep_every_tick() -> None:
    told = yaml.safe_load((BRINGUP / "config" / "rosbag2_qos.yaml").read_text(encoding="utf-8"))
    assert list(told) == [f"/{topic.name}" for topic in TOPICS]
    for topic in TOPICS:
        qos = told[f"/{topic.name}"]
        asked = (topic.qos.reliability.name.lower(), topic.qos.durability.name.lower(), "keep_last")
        assert (qos["reliability"], qos["durability"], qos["history"]) == asked
        assert qos["depth"] >= topic.qos.depth


def test_no_node_hides_an_attribute_of_rclpy() -> None:
    """rclpy's Node has private attributes of plain names; one of ours once took the place of its parameters."""
    source = Path(inspect.getfile(Node)).read_text(encoding="utf-8")
    theirs = set(dir(Node)) | set(re.findall(r"self\.(_[a-z]\w*)", source))
    sources = ROOT / "ros2_ws" / "src"
    for path in {*sources.glob("*/*/ros/*.py"), *sources.rglob("*node.py")}:
        text = path.read_text(encoding="utf-8")
        if "(Node)" in text:
            ours = set(re.findall(r"self\.(\w+)(?:: [^=\n]+)? =", text)) | set(re.findall(r"def (\w+)\(self", text))
            assert ours & theirs <= {"__init__"}, path
