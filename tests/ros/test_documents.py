"""What the nodes do is what docs, parameter files, layouts for viewers and the SROS 2 policy say, and nothing else."""

import inspect
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import rclpy
import yaml
from rabbit_bringup.launching.walk import WalkOptions
from rabbit_bringup.ros.walk_monitor import WalkMonitor
from rabbit_common.ros.topics import TOPICS
from rabbit_description import robot_description
from rabbit_experiments.assembly import Assembly
from rabbit_recording.open_recording import opened
from rabbit_sim.parameters import PlayerParameters, SimulationParameters
from rabbit_sim.ros.publishers import RabbitPublishers
from rabbit_viewer.ros.rviz import RvizTopics
from rclpy.node import Node, NodeNameNonExistentError
from recorded_walk import walk, write_bag
from rl_cbf_clf_controller.parameters import ControllerParameters

__all__ = ["walk", "write_bag"]
ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "ros2_ws" / "src" / "rabbit_bringup" / "config"


def test_rosbag2_is_told_how_to_keep_every_tick() -> None:
    told = yaml.safe_load((CONFIG / "rosbag2_qos.yaml").read_text(encoding="utf-8"))
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
            assert ours & theirs <= set(re.findall(r"super\(\)\.(\w+)\(", text)), path


POLICY = CONFIG / "sros2_policy.xml"
NODES = ("simulator", "controller", "trainer", "recorder", "viewer")
LAB = {"/measured", "/imu", "/true_state"}  # published with a lab's sensors, in place of `state`
QUALIFIERS = {"topics": ("publish", "subscribe"), "services": ("reply", "request")}
PATIENCE = 180.0  # s, for nodes to start and to be found
Rights = dict[str, set[str]]  # names by publish, subscribe, reply, request


def allowed(profile: ElementTree.Element) -> Rights:
    """What a profile allows, by full names as SROS 2 reads them."""
    rights: Rights = {"publish": set(), "subscribe": set(), "reply": set(), "request": set()}
    for rule in profile:
        for qualifier in QUALIFIERS[rule.tag]:
            if rule.get(qualifier) is not None:
                assert rule.get(qualifier) == "ALLOW"
                names = [str(name.text).replace("~", f"/{profile.get('node')}") for name in rule]
                rights[qualifier] |= {name if name.startswith("/") else f"/{name}" for name in names}
    return rights


def enclaves() -> dict[str, dict[str, Rights]]:
    """Rights by enclave and node."""
    found = ElementTree.parse(POLICY).iterfind("enclaves/enclave")
    return {str(e.get("path")): {str(p.get("node")): allowed(p) for p in e.iter("profile")} for e in found}


def done(node: Any, name: str) -> Rights:
    """What the node of this name has opened in the graph."""
    asked = {
        "publish": node.get_publisher_names_and_types_by_node,
        "subscribe": node.get_subscriber_names_and_types_by_node,
        "reply": node.get_service_names_and_types_by_node,
        "request": node.get_client_names_and_types_by_node,
    }
    try:
        return {qualifier: {topic for topic, _ in ask(name, "/")} for qualifier, ask in asked.items()}
    except NodeNameNonExistentError:
        return {}


def assert_settles(graph: Any, node: str, wanted: Rights) -> None:
    """That a node does just what is wanted, within all patience."""
    end = time.monotonic() + PATIENCE
    while (now := done(graph.node, node)) != wanted and time.monotonic() < end:
        graph.spin(0.2)
    assert now == wanted, node


def test_every_node_does_just_what_its_enclave_allows(root_world: Any, tmp_path: Path) -> None:
    """And the launcher, in the namespace that the policy is for."""
    policy, own = enclaves(), {"viewer": {"port": 0}, "recorder": {"path": str(tmp_path / "recording")}}
    policy["/rabbit/simulator"]["simulator"]["publish"] -= LAB
    for name in NODES:
        root_world.start(name, **own.get(name, {}))
    with closing(WalkMonitor(WalkOptions(), root_world.processes)):
        for enclave in (*NODES, "launcher"):
            for node, rights in policy[f"/rabbit/{enclave}"].items():
                assert_settles(root_world, node, rights)


def test_with_a_labs_sensors_the_state_is_the_estimators(root_world: Any) -> None:
    rights = enclaves()
    rights["/rabbit/simulator"]["simulator"]["publish"] -= {"/state", "/tf", "/robot_description"}
    root_world.start("simulator", sensors="lab")
    root_world.start("estimator")
    for node in ("simulator", "estimator"):
        assert_settles(root_world, node, rights[f"/rabbit/{node}"][node])


def test_ros2_control_in_the_simulators_place(root_world: Any) -> None:
    for name in ("ros2_control", "command_guard"):
        root_world.processes.start(name, (), name, "rabbit_bringup")
    for name in ("ros2_control", "command_guard"):
        assert_settles(root_world, name, enclaves()[f"/rabbit/{name}"][name])


def test_a_viewer_that_may_control_calls_three_services_more(root_world: Any) -> None:
    policy = enclaves()
    more = {"/pause", "/reset_episode", "/load_policy"}
    for node, rights in policy["/rabbit/viewer"].items():
        expected = {**rights, "request": rights["request"] | (more if node == "viewer" else set())}
        assert policy["/rabbit/viewer_control"][node] == expected
    root_world.start("simulator")
    root_world.start("controller")
    root_world.start("viewer", port=0, control=True)
    for node, rights in policy["/rabbit/viewer_control"].items():
        assert_settles(root_world, node, rights)


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
