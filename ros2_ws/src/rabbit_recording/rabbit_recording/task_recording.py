"""A ride as a recording on the graph's topics, and back: what was recorded must come out of the controller again."""

import json
from array import array
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_common.executables import sourced_share
from rabbit_common.message_checks import Refused, check_lengths, doubles
from rabbit_common.task_messages import measured_fields, parameter_fields, state_of
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask
from rabbit_description.task_state import layout_of, p_of
from rl_cbf_clf_controller.explanation import changes, explain
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.task_controller import NOMINAL, Controlling, TaskController
from rl_cbf_clf_controller.weights import PolicyFileError, decode
from rl_trainer.rollout import Record
from rl_trainer.task_episode import Moment, Ride, moment_of
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.explaining import ExplainedTick
from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.reader import iterate_inventories, messages

RUNNING, ENDED = 1, 3  # phases of rabbit_msgs/Episode
FOREVER = QosTime(9223372036, 854775807)
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
        bag.add(f"/{topic}", f"rabbit_msgs/msg/{kind}", [offered(topic in LATCHED)])

    def add(topic: str, tick: int, **given: Any) -> None:
        """One message; what is not given is empty or 0."""
        kind, at = f"rabbit_msgs/msg/{KINDS[topic]}", round(tick * task.seconds * 1e9)
        stamp = types.types["builtin_interfaces/msg/Time"](*divmod(at, 10**9))
        header = types.types["std_msgs/msg/Header"](stamp, "")
        known = {"header": header, "episode": 1, "tick": tick, "sender": ride.controller, **given}
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
    """Of a field that nobody gives: 0, or an empty sequence."""
    node, detail = form
    if node.name == "BASE":
        return ZERO[detail[0]]
    inner = detail[0][1][0]
    return [] if inner == "string" else np.zeros(0, inner)


def offered(latched: bool) -> Qos:
    """As docs/topics.md has them: latched events, or every tick."""
    durability, depth = (QosDurability.TRANSIENT_LOCAL, 20) if latched else (QosDurability.VOLATILE, 5000)
    kept = QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, durability
    return Qos(*kept, FOREVER, FOREVER, QosLiveliness.AUTOMATIC, FOREVER, avoid_ros_namespace_conventions=False)


def recorded_ticks(
    task: ControlTask, path: Path, policies: dict[str, bytes], episodes: dict[int, Any]
) -> Iterator[tuple[Any, RobotState]]:
    """The answer, a `TorqueCommand`, to each state that was heard whole.

    `policies` gets the recorded ones by version, `episodes` the newest announcement of each.

    A recorder may have heard state, parameters and torque in any order.

    Raises `RecordingError` where it is of another task.
    """
    heard: dict[str, dict[tuple[int, int], Any]] = {name: {} for name in ("state", "parameters", "torque")}
    layout = [layout_of(task).names[name] for name in ("coordinates", "joints")]
    for topic, m in messages(path, "episode", "policy_swap", *heard):
        if topic == "episode" and [m.coordinates, m.joints] != layout:
            was = ", ".join((*m.coordinates, *m.joints))
            raise RecordingError(f"recording {path}: of another system, with {was}; not of {task.name}")
        if topic == "policy_swap" and m.accepted:
            policies[m.version] = bytes(m.data)
        if topic == "episode":
            episodes[m.episode] = m
        if topic not in heard:
            continue
        turn = (m.episode, m.tick)
        heard[topic][turn] = m
        if all(turn in each for each in heard.values()):
            state, parameters, torque = (each.pop(turn) for each in heard.values())
            try:
                check_lengths(torque, {"torque": len(task.names_of_u)})
                measured = state_of(task, state, parameters)
            except Refused as error:
                raise RecordingError(f"recording {path}: tick {turn}: {error}") from error
            yield torque, measured


def replayed(task: ControlTask, path: Path) -> Iterator[tuple[Any, Moment]]:
    """Each recorded answer, a `TorqueCommand`, and what its controller makes of the state again.

    Raises `RecordingError`, also where a policy is not in it or not for this task, or no tick of the task.
    """
    controller, policies, by = TaskController(task), dict[str, bytes](), None
    episodes, began = dict[int, Any](), None
    for answer, state in recorded_ticks(task, path, policies, episodes):
        if answer.episode != began and (said := episodes.get(answer.episode)):
            controller.reset(said.seed)
            controller.sigma, began = float(np.nan_to_num(said.sigma)), answer.episode
        if answer.policy_version != by or not state.tick:
            by = answer.policy_version
            controller.policy = recorded_controller(controller, path, by, policies)
        yield answer, moment_of(controller, Record(state, controller.step(state)))
    if by is None:
        raise RecordingError(f"recording {path}: no tick of {task.name} in it")


def differing(task: ControlTask, path: Path) -> tuple[int, list[int], float]:
    """How many ticks were replayed, which did not come out to the bit, and by how much at most (in the input's unit).

    Raises `RecordingError`, as `replayed`.
    """
    count, wrong, furthest = 0, list[int](), 0.0
    for answer, moment in replayed(task, path):
        count += 1
        if off := float(np.abs(moment.u - answer.torque).max()):
            wrong.append(answer.tick)
            furthest = max(furthest, off)
    return count, wrong, furthest


def recorded_ride(task: ControlTask, path: Path, number: int | None = None) -> Ride:
    """Episode `number`, or the last one that has ticks, with its recorded inputs; raises `RecordingError`."""
    ride, newest, after = None, None, 0
    for answer, moment in replayed(task, path):
        if number in (None, answer.episode):
            if ride is None or answer.episode != newest:
                ride, newest = Ride(task, answer.policy_version, 0), answer.episode
            after = answer.tick + 1
            ride.moments.append(replace(moment, output=replace(moment.output, torque=np.array(answer.torque))))
    if ride is None:
        raise RecordingError(f"recording {path}: no tick of episode {number} in it")
    said = next(each for each in iterate_inventories(path) if each.number == newest)
    ride.seed, ride.outcome, ride.impacts = said.seed, said.outcome or "not recorded to its end", said.touchdowns
    heard = {name: m for name, m in messages(path, "state", "parameters") if (m.episode, m.tick) == (newest, after)}
    if len(heard) == 2:
        with one_line_errors(path, f"tick {after}"):
            ride.last = state_of(task, heard["state"], heard["parameters"])
    ride.reason = said.reason
    return ride


def recorded_controller(controller: TaskController, path: Path, by: str, policies: dict[str, bytes]) -> Controlling:
    """Who made a torque: a controller by its name, or a policy that is in the recording."""
    if by == "zero":
        return NOMINAL
    if by in controller.names:
        return by
    if ":" in by:
        with one_line_errors(path, f"controller {by}"):
            return controller.controlling(by)
    try:
        return controller.fitted(decode(policies[by]))
    except (KeyError, PolicyFileError, ValueError) as error:
        raise RecordingError(f"recording {path}: policy {by} is not in it, or not for this task: {error}") from error


def explain_ride(ride: Ride, tick: int | None = None) -> ExplainedTick:
    """A tick of a ride; the one whose slacks of last resort are largest in all, where none is named.

    Raises ValueError where there is nothing to explain.
    """
    if tick is None:
        tick = int(np.nan_to_num([moment.output.rescue_slack for moment in ride.moments], nan=-1.0).argmax())
    if not 0 <= tick < len(ride.moments):
        raise ValueError(f"tick {tick} of {ride.controller}: expected one from 0 to {len(ride.moments) - 1}")
    now, *before = [ride.moments[k] for k in (tick, tick - 1) if k >= 0]
    if now.decided is None:
        raise ValueError(f"tick {tick} of {ride.controller}: it has no QP")
    explanation, *others = [explain(ride.task.tick, m.x, m.p, m.estimates, m.decided) for m in (now, *before)]
    changed = changes(others[0], explanation) or ["no row changed"] if others else ["it is the first"]
    title = f"{ride.task.name}, {ride.controller}, tick {tick} ({now.output.step_time:.2f} s)"
    return ExplainedTick(title, f"answered by {now.decided.solver}", explanation, changed)
