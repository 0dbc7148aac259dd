"""A ride as a recording on the graph's topics, and back: what was recorded must come out of the controller again."""

import json
from array import array
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_common.executables import sourced_share
from rabbit_common.message_checks import doubles
from rabbit_common.task_messages import measured_fields, parameter_fields
from rabbit_description.task import ControlTask
from rabbit_description.task_state import layout_of, p_of
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_trainer.rollout import Record
from rl_trainer.task_episode import Ride, moment_of

from rabbit_recording.bag_writer import BagWriter, graph_types, offered
from rabbit_recording.checking import replayed
from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.reader import last_episode

RUNNING, ENDED = 1, 3  # phases of rabbit_msgs/Episode
KINDS = {
    **{"episode": "Episode", "policy_swap": "PolicySwap", "controller_settings": "ControllerSettings"},
    **{"state": "RobotState", "parameters": "TaskParameters", "torque": "TorqueCommand"},
    **{"controller_state": "ControllerState", "learner_terms": "LearnerTerms"},
}
LATCHED = ("episode", "policy_swap", "controller_settings")
ZERO = {"float64": 0.0, "uint8": 0, "uint32": 0, "uint64": 0, "bool": False, "string": ""}


def write_ride(ride: Ride, path: Path, policy: ActorPolicy | None = None) -> None:
    """Write the messages of a ride, its only episode; `policy`: what rode, of a learned controller.

    Raises `RecordingError`.
    """
    task, types = ride.task, graph_types([sourced_share("rabbit_msgs")])
    bag = BagWriter(path, types)
    for topic, kind in KINDS.items():
        qos = offered(20, "TRANSIENT_LOCAL") if topic in LATCHED else offered(5000)
        bag.add(f"/{topic}", f"rabbit_msgs/msg/{kind}", [qos])

    def add(topic: str, tick: int, **fields: Any) -> None:
        """One message; other fields are empty or 0."""
        kind, at = f"rabbit_msgs/msg/{KINDS[topic]}", round(tick * task.seconds * 1e9)
        stamp = types.types["builtin_interfaces/msg/Time"](*divmod(at, 10**9))
        header = types.types["std_msgs/msg/Header"](stamp, "")
        known = {"header": header, "episode": 1, "tick": tick, "sender": ride.controller, **fields}
        values = {name: known[name] if name in known else empty(form) for name, form in types.fielddefs[kind][1]}
        values = {name: np.array(value) if isinstance(value, array) else value for name, value in values.items()}
        bag.write(f"/{topic}", at, bytes(types.serialize_cdr(types.types[kind](**values), kind)))

    about = {"task": task.name, "controller": ride.controller, "seconds": task.seconds, "nominal": task.nominal}
    add("controller_settings", 0, parameters=json.dumps(about))
    if policy:
        data = np.frombuffer(policy.file.encode(), np.uint8)
        add("policy_swap", 0, version=policy.version, accepted=True, data=data)
    episode = {"seed": ride.seed, "controller": ride.controller, "sigma": 0.0, "tick_seconds": task.seconds}
    episode |= layout_of(task).names
    add("episode", 0, phase=RUNNING, **episode)
    for k, moment in enumerate(ride.moments):
        add("state", k, **measured_fields(moment.state))
        add("parameters", k, **parameter_fields(task, moment.p))
        add("torque", k, torque=doubles(moment.u), policy_version=ride.controller)
        add("controller_state", k, **state_fields(moment.output))
        if moment.output.quantities:
            add("learner_terms", k, **terms_fields(moment.output))
    last = ride.last
    if last is not None and np.isfinite(last.q).all():
        add("parameters", len(ride.moments), **parameter_fields(task, p_of(last)))
        add("state", len(ride.moments), **measured_fields(last))
    ended = {"outcome": ride.outcome, "reason": ride.reason[:128], "touchdowns": ride.impacts}
    add("episode", len(ride.moments), phase=ENDED, **ended, **episode)
    bag.close()


def empty(form: Any) -> Any:
    """The value of a field that nobody gives: 0, or an empty sequence."""
    node, detail = form
    if node.name == "BASE":
        return ZERO[detail[0]]
    inner = detail[0][1][0]
    return [] if inner == "string" else np.zeros(0, inner)


def recorded_ride(task: ControlTask, path: Path, number: int | None = None) -> Ride:
    """Episode `number`, or the last one that has ticks, with its recorded inputs; raises `RecordingError`."""
    episode = last_episode(path, number, task)
    ride = Ride(task, episode.swaps[0].version, episode.seed, impacts=episode.touchdowns, last=episode.end)
    ride.outcome, ride.reason = episode.outcome or "not recorded to its end", episode.reason
    with one_line_errors(path, f"episode {episode.number} cannot be replayed"):
        for record, (controller, output) in zip(episode.records, replayed(episode, task), strict=True):
            recorded = replace(output, torque=record.output.torque)
            ride.moments.append(moment_of(controller, Record(record.state, recorded)))
    return ride
