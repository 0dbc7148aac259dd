"""docs/topics.md, the parameter files and the nodes say the same."""

import ast
import inspect
import re
from pathlib import Path
from typing import Any

import rabbit_estimator.parameters
import rl_cbf_clf_controller.ros.node
import rl_cbf_clf_controller.ros.policies
import rl_trainer.ros.node
import yaml
from pydantic import BaseModel
from rabbit_bringup.launching.processes import PACKAGES
from rabbit_common.ros.topics import SERVICES, TOPICS
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_recording.ros import recorder as recorder_node
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.ros import node as simulator
from rabbit_viewer.live.parameters import ViewerParameters
from rclpy.node import Node
from rl_trainer.parameters import TrainingParameters

ROOT = Path(__file__).parents[2]
BRINGUP = ROOT / "ros2_ws" / "src" / "rabbit_bringup"
PAGE = (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")
MODELS: dict[str, tuple[type[BaseModel], ...]] = {
    "simulator": (simulator.NodeParameters, SimulationParameters),
    "estimator": (rabbit_estimator.parameters.NodeParameters, EstimatorParameters),
    "controller": (rl_cbf_clf_controller.ros.policies.NodeParameters, rl_cbf_clf_controller.ros.node.Settings),
    "trainer": (rl_trainer.ros.node.NodeParameters, TrainingParameters),
    "recorder": (recorder_node.NodeParameters,),
    "viewer": (ViewerParameters,),
}


def row(name: str) -> list[str]:
    """Cells of the table row that begins with a name."""
    found = re.search(rf"^\| `{name}` \|(.*)\|$", PAGE, re.MULTILINE)
    assert found, name
    return [cell.strip() for cell in found[1].split("|")]


def test_topics_page_lists_every_topic() -> None:
    for topic in TOPICS:
        kind, publisher, readers, qos, *_ = row(topic.name)
        package, _, name = topic.type_name.split("/")
        assert (kind, publisher) == (f"`{package}/{name}`", topic.publisher)
        assert set(topic.readers) - {"launcher"} <= set(readers.split(", "))
        depth = re.search(r"last (\d+)", " ".join(row_of_qos(qos)))
        assert depth is not None
        assert int(depth[1]) == topic.qos.depth
        assert row_of_qos(qos)[0] == topic.qos.reliability.name.lower().replace("_", " ")
        assert row_of_qos(qos)[1] == topic.qos.durability.name.lower().replace("_", " ")


def test_each_packages_readme_names_its_nodes_topics_and_services() -> None:
    for node, package in PACKAGES.items():
        text = (BRINGUP.parent / package / "README.md").read_text(encoding="utf-8")
        wanted = {topic.name for topic in TOPICS if node in (topic.publisher, *topic.readers)}
        wanted |= {service.name for service in SERVICES if service.node == node}
        assert wanted <= set(re.findall(r"`(\w+)`", text)), package


def row_of_qos(name: str) -> list[str]:
    """Cells of a QoS profile's row."""
    found = re.search(rf"^\| {name} \|(.*)\|$", PAGE, re.MULTILINE)
    assert found, name
    return [cell.strip() for cell in found[1].split("|")]


def test_topics_page_lists_the_nodes_own_parameters() -> None:
    for node, (own, *_) in MODELS.items():
        named = set(re.findall(r"`(\w+)`", next(line for line in parameter_rows() if line.startswith(f"| `{node}` |"))))
        assert set(own.model_fields) <= named
        known = {name for model in MODELS[node] for name in model.model_fields}
        assert named - {node} <= known


def parameter_rows() -> list[str]:
    """Lines of the parameter table."""
    return PAGE[PAGE.index("## Parameters") : PAGE.index("## Recordings")].splitlines()


def test_every_parameter_is_described() -> None:
    for model in {model for models in MODELS.values() for model in models}:
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"


def test_graph_yaml_names_known_parameters_with_their_values() -> None:
    content = yaml.safe_load((BRINGUP / "config" / "graph.yaml").read_text(encoding="utf-8"))
    assert {key.removeprefix("/**/") for key in content} <= set(MODELS)
    for key, body in content.items():
        left: dict[str, Any] = dict(body["ros__parameters"])
        for model in MODELS[key.removeprefix("/**/")]:
            model.model_validate({name: left.pop(name) for name in list(left) if name in model.model_fields})
        assert not left


def test_rosbag2_is_told_how_to_keep_every_tick() -> None:
    told = yaml.safe_load((BRINGUP / "config" / "rosbag2_qos.yaml").read_text(encoding="utf-8"))
    assert list(told) == [f"/{topic.name}" for topic in TOPICS]
    for topic in TOPICS:
        qos = told[f"/{topic.name}"]
        asked = (topic.qos.reliability.name.lower(), topic.qos.durability.name.lower(), "keep_last")
        assert (qos["reliability"], qos["durability"], qos["history"]) == asked
        assert qos["depth"] >= topic.qos.depth


def test_walk_launch_leaves_nodes_and_parameters_to_rabbit_walk() -> None:
    tree = ast.parse((BRINGUP / "launch" / "walk.launch.py").read_text(encoding="utf-8"))
    called = {getattr(node.func, "id", "") for node in ast.walk(tree) if isinstance(node, ast.Call)}
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert {"arguments_of", "ExecuteProcess"} <= called
    assert {"rabbit", "walk"} <= words
    assert not words & {*MODELS}


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
