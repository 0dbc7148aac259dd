"""Fixtures: a short walk in process, and recordings of it as the graph would have made them, without ROS."""

import math
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from rabbit_common.task_messages import measured_fields
from rabbit_description.gait import load_gait
from rabbit_description.state import LAYOUT, TICK_SECONDS
from rabbit_recording.bag_writer import BagWriter, graph_types, offered
from rabbit_recording.reader import RecordedEpisode, iterate_episodes
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing, Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.rollout import Record, rollout

DRAWS = pytest.mark.skipif(not entry_points(group="rabbit.pictures"), reason="rabbit_viewer, which draws, is not there")
MESSAGES = Path(get_package_share_directory("rabbit_msgs"))
TYPES = graph_types([MESSAGES])
TICK_NS, SEED = 10_000_000, 3
LATCHED = offered(20, "TRANSIENT_LOCAL")
TOPICS = {
    "state": "RobotState",
    "preview": "StonePreview",
    "landing": "Landing",
    "episode": "Episode",
    "torque": "TorqueCommand",
    "controller_state": "ControllerState",
    "learner_terms": "LearnerTerms",
    "policy_swap": "PolicySwap",
    "controller_settings": "ControllerSettings",
}


CONTROLLER = "/controller 0123456789abcdef"
WHO = {
    "sender": CONTROLLER,
    "controller": CONTROLLER,
    "refused_controller": "",
    **{name: list(names) for name, names in LAYOUT.names.items()},
    "tick_seconds": TICK_SECONDS,
}  # in messages that say so


@dataclass(frozen=True)
class Walk:
    """What a rollout gave."""

    parameters: ControllerParameters
    records: list[Record]
    landings: list[Landing]


@pytest.fixture(scope="session")
def walk() -> Walk:
    """Two stones under the nominal controller, with exploration so that its seed matters."""
    parameters = ControllerParameters(sigma=1.0)
    gait = load_gait(parameters.gait)
    simulation = Simulation(SimulationParameters(stones=2), gait)
    records: list[Record] = []
    rollout(simulation, Controller(parameters, gait, ZeroPolicy(parameters.problem)), SEED, records.append)
    simulation.close()
    return Walk(parameters, records, simulation.landings)


@pytest.fixture
def write_bag(walk: Walk) -> Callable[..., Path]:
    """Records the walk into a folder; `change` may alter a (topic, message) or drop it (None)."""

    def write_walk(path: Path, change: Any = lambda topic, message: message) -> Path:
        kept = ((topic, tick * TICK_NS, change(topic, message)) for topic, tick, message in told(walk))
        return write(path, (entry for entry in kept if entry[2]))

    return write_walk


def write(path: Path, messages: Iterable[tuple[str, int, Any]]) -> Path:
    """A recording of topics, times in ns and messages."""
    writer = BagWriter(path, TYPES)
    for topic, name in TOPICS.items():
        writer.add(f"/{topic}", f"rabbit_msgs/msg/{name}", [LATCHED])
    for topic, nanoseconds, what in messages:
        data = bytes(TYPES.serialize_cdr(what, f"rabbit_msgs/msg/{TOPICS[topic]}"))
        writer.write(f"/{topic}", nanoseconds, data)
    writer.close()
    return path


def message(topic: str, tick: int, **fields: Any) -> Any:
    """A message of episode 1, its other fields empty."""
    seconds, nanoseconds = divmod(tick * TICK_NS, 10**9)
    stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    header = TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id="world")
    kind: Any = TYPES.types[f"rabbit_msgs/msg/{TOPICS[topic]}"]
    names = {name: value for name, value in WHO.items() if name in kind.__dataclass_fields__}
    head = {"header": header, "episode": 1, **({"tick": tick} if topic != "preview" else {})}
    arrays = {name: np.array(value) for name, value in fields.items() if isinstance(value, array)}  # for `rosbags`
    return kind(**head | names | fields | arrays)


def told(walk: Walk) -> Iterator[tuple[str, int, Any]]:
    """Topic, tick and message, in the order in which the nodes tell them."""
    episode = {"seed": SEED, "stones": 2, "reason": "", "policy_version": "", "sigma": math.nan}
    yield "episode", 0, message("episode", 0, phase=1, touchdowns=0, outcome="", **episode)
    swap = {"version": "zero", "source": "built in", "accepted": True, "reason": "", "data": np.zeros(0, np.uint8)}
    yield "policy_swap", 0, message("policy_swap", 0, **swap)
    gait = load_gait(walk.parameters.gait).model_dump_json()
    settings = {"parameters": walk.parameters.model_dump_json(), "gait": gait}
    yield "controller_settings", 0, message("controller_settings", 0, **settings)
    seen = None
    for record in walk.records:
        state, tick = record.state, record.state.tick
        if state.preview is not None and state.preview != seen:
            seen = state.preview
            yield "preview", tick, message("preview", tick, **asdict(seen))
        yield "state", tick, state_message(state)
        torque = record.output.torque.copy()  # a test may change a message, but not the walk
        yield "torque", tick, message("torque", tick, torque=torque, policy_version="zero", fault="")
        yield "controller_state", tick, message("controller_state", tick, **state_fields(record.output))
        yield "learner_terms", tick, message("learner_terms", tick, **terms_fields(record.output))
    end = walk.records[-1].state.tick + 1
    for landing in walk.landings:
        fields = {name: getattr(landing, name) for name in Landing.__dataclass_fields__}
        yield "landing", landing.tick, message("landing", **fields)
    yield "episode", end, message("episode", end, phase=3, touchdowns=2, outcome="walked", **episode)


def state_message(state: Any) -> Any:
    """A `RobotState`."""
    return message(
        "state",
        state.tick,
        **measured_fields(state),
        foot_force=np.array(state.foot_force).ravel(),
        contact=np.array(state.contact, dtype=bool),
        previewed=state.preview is not None,
    )


def read_episodes(path: Path) -> dict[int, RecordedEpisode]:
    """All episodes of a recording, by number."""
    return {episode.number: episode for episode in iterate_episodes(path)}
