"""The layouts for Foxglove, PlotJuggler and RViz name topics and fields that recordings and nodes really have."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import rclpy
import yaml
from rabbit_description import robot_description
from rabbit_experiments.assembly import Assembly
from rabbit_recording.open_recording import opened
from rabbit_sim.parameters import PlayerParameters, SimulationParameters
from rabbit_sim.ros.publishers import RabbitPublishers
from rabbit_viewer.ros.rviz import RvizTopics
from recorded_walk import walk, write_bag
from rl_cbf_clf_controller.parameters import ControllerParameters

__all__ = ["walk", "write_bag"]
CONFIG = Path(__file__).parents[2] / "ros2_ws" / "src" / "rabbit_bringup" / "config"
TYPES = {"RobotModel": "std_msgs/msg/String", "MarkerArray": "visualization_msgs/msg/MarkerArray"}
TYPES |= {"Wrench": "geometry_msgs/msg/WrenchStamped"}
PATH = re.compile(r"/(\w+)(?:[./](\w+)(?:\[(\d+)\])?)?")


@pytest.fixture
def newest(tmp_path: Path, write_bag: Callable[..., Path]) -> dict[str, Any]:
    """Of each topic of a recording its newest message."""
    with opened(write_bag(tmp_path / "bag")) as reader:
        return {c.topic[1:]: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}


def value_at(newest: dict[str, Any], path: str) -> Any:
    """As both tools read it: `/torque.torque[0]`, `/torque/torque[0]`."""
    found = PATH.fullmatch(path)
    assert found, path
    topic, field, index = found.groups()
    value = getattr(newest[topic], field) if field else newest[topic]
    return value[int(index)] if index else value


def values_in(layout: Any) -> Iterator[dict[str, Any]]:
    """What a layout of Foxglove shows."""
    for panel in layout["configById"].values():
        yield from panel.get("paths", [{"value": panel["topicPath"]}] if "topicPath" in panel else [])


def test_foxglove_plots_what_its_labels_say(newest: dict[str, Any]) -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    shown = [value for value in values_in(layout) if value["value"].startswith("/")]
    assert len(shown) > 10
    names = {"values": newest["controller_state"].names, "torque": newest["episode"].joints}
    for path, label in ((value["value"], value.get("label")) for value in shown):
        value = value_at(newest, path)
        if label:
            assert np.isfinite(value)
        field, index = PATH.fullmatch(path).groups()[1:]  # type: ignore[union-attr]
        if field in names:
            assert names[field][int(index)].replace("_", " ") == label
    placed = json.dumps(layout["layout"])
    assert all(f'"{panel}"' in placed for panel in layout["configById"])


def test_plotjuggler_plots_numbers_of_a_recording(newest: dict[str, Any]) -> None:
    curves = [curve.attrib["name"] for curve in ElementTree.parse(CONFIG / "plotjuggler.xml").iter("curve")]
    assert len(curves) > 10
    for name in curves:
        assert np.isfinite(value_at(newest, name)), name


def test_rviz_and_foxglove_show_what_simulator_and_viewer_publish() -> None:
    in_foxglove = json.loads((CONFIG / "foxglove.json").read_text())["configById"]["3D!robot"]
    layout = yaml.safe_load((CONFIG / "walk.rviz").read_text())["Visualization Manager"]
    simulation, _ = Assembly(SimulationParameters(stones=2), ControllerParameters(), "zero").build()
    rclpy.init()
    try:
        node = rclpy.create_node("both")
        publishers = RabbitPublishers(node, simulation, PlayerParameters(), "me"), RvizTopics(node)
        topics = dict(node.get_publisher_names_and_types_by_node("both", "/"))
        assert publishers
    finally:
        rclpy.shutdown()
        simulation.close()
    assert len(layout["Displays"]) == 4
    for display in layout["Displays"]:
        topic = display.get("Topic", display.get("Description Topic"))["Value"]
        assert topics[f"/{topic}"] == [TYPES[display["Class"].split("/")[1]]]
    assert in_foxglove["topics"].keys() < topics.keys()
    frames = re.findall('<link name="(.*?)"', robot_description())
    followed = {layout["Views"]["Current"]["Target Frame"], in_foxglove["followTf"]}
    assert {layout["Global Options"]["Fixed Frame"], *followed} <= set(frames)
