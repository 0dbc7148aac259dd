"""docs/topics.md, the parameter files and the nodes say the same."""

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
from rabbit_common.ros.topics import TOPICS
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_recording.ros import recorder as recorder_node
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.ros import node as simulator
from rabbit_viewer.live.parameters import ViewerParameters
from rclpy.node import Node
from rl_trainer.parameters import TrainingParameters

ROOT = Path(__file__).parents[2]
BRINGUP = ROOT / "ros2_ws" / "src" / "rabbit_bringup"
MODELS: dict[str, tuple[type[BaseModel], ...]] = {
    "simulator": (simulator.NodeParameters, SimulationParameters),
    "estimator": (rabbit_estimator.parameters.NodeParameters, EstimatorParameters),
    "controller": (rl_cbf_clf_controller.ros.policies.NodeParameters, rl_cbf_clf_controller.ros.node.Settings),
    "trainer": (rl_trainer.ros.node.NodeParameters, TrainingParameters),
    "recorder": (recorder_node.NodeParameters,),
    "viewer": (ViewerParameters,),
}


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
