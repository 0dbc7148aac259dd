"""RABBIT's tick as one function, see `step.py`: leg swap, the step's begin (`step_begin.py`), what is identified."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.estimates import model_error
from cbf_clf_qp.functions import Layout, NumpyFunction, is_finite, places_of, values_type
from cbf_clf_qp.tick import Tick
from rabbit_description.gait import Gaits
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import DOF, FEET, JOINTS, SWAP_STATE, SWAP_TORQUE, Array, StonePreview, no_torque

from rl_cbf_clf_controller.identification import LATE_TORQUE, window
from rl_cbf_clf_controller.identified_robot import after_tick, first_known, rate_error
from rl_cbf_clf_controller.joint_calibration import OFFSETS
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.least_squares import within
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.planar_robot import robot_parameters
from rl_cbf_clf_controller.robot_numbers import Feet, RobotNumbers
from rl_cbf_clf_controller.state_prediction import prediction_function
from rl_cbf_clf_controller.step import DQ, STONE, Q, StepFunctions, call, ordered, row_function, symbols
from rl_cbf_clf_controller.step_begin import kept_at_first, step_functions
from rl_cbf_clf_controller.step_paths import GaitExpressions, Shape, gait_row
from rl_cbf_clf_controller.tick_functions import tick_functions
from rl_cbf_clf_controller.walking import GAINS, Walking

NEVER = -2  # a tick that none follows
CARRIED = 20.0  # N; a foot that presses less may be falling
CONTRADICTED = 0.06, 0.12  # rad/s, from which on the angles count less, and not at all
FARTHEST_STONE, HIGHEST_STONE = 2.0, 0.5  # m; the latter up or down
FORCES = len(FEET) * SLIDES  # tangential and normal
READING = {
    **{"tick": 1, "touchdowns": 1, "q": DOF, "dq": DOF, "foot_force": FORCES, "contact": len(FEET)},
    **{"applied": JOINTS, "stone": len(fields(StonePreview)), "noise": JOINTS},
}
SETTINGS = ("swap_time", "swap_phase", "doubt_eps", "late_margin", "stone_aim", "slope_change", *GAINS)


def stand_function(walking: Walking, on_stones: bool, tick_seconds: float) -> NumpyFunction:
    """Which leg stands, and the state in stance/swing order, of memory, reading and settings; see the module."""
    sizes = {"stance": 1, "index": 1, "start": 1, "seconds": 1, "has_begun": 1, "last_tick": 1, "phase_scale": 2}
    sizes |= {"torque": JOINTS, "held": JOINTS, "offsets": 2, "swap_time": 1, "swap_phase": 1}
    s = symbols({**sizes, **{name: READING[name] for name in READING if name != "noise"}})
    q = s["q"] - ca.DM(OFFSETS) @ s["offsets"]
    tick, is_right = s["tick"], s["stance"]
    is_known = is_finite(s["applied"])
    held = ca.if_else(is_known, s["applied"], s["held"])
    torque = ca.if_else(is_known, ordered(s["applied"], SWAP_TORQUE, is_right), s["torque"])
    seconds = (tick - s["start"]) * tick_seconds
    phase_of = [walking.robot.q, walking.outputs.parameters["phase_scale"]]
    (in_phase,) = ca.substitute([walking.outputs.phase], phase_of, [ordered(q, SWAP_STATE, is_right), s["phase_scale"]])
    down = ca.if_else(is_right, s["contact"][0], s["contact"][1])
    swaps = ca.logic_and(down, ca.logic_and(seconds > s["swap_time"], in_phase > s["swap_phase"]))
    stance = ca.if_else(swaps, 1 - is_right, is_right)
    refused = ca.if_else(is_finite(s["q"]), ca.if_else(is_finite(s["dq"]), 0, DQ), Q)
    if on_stones:
        index, near, far, height = ca.vertsplit(s["stone"])
        is_stone = ca.logic_and(index == s["touchdowns"] + 1, ca.fabs(height) <= HIGHEST_STONE)
        is_stone = ca.logic_and(is_stone, ca.logic_and(ca.logic_and(near > 0, near < far), far < FARTHEST_STONE))
        refused = ca.if_else(refused, refused, ca.if_else(is_stone, 0, STONE))
    force = ca.if_else(stance, s["foot_force"][[2, 3, 0, 1]], s["foot_force"])
    outputs = {
        "refused": refused,
        "stance": stance,
        "index": s["index"] + swaps,
        "start": ca.if_else(swaps, tick, s["start"]),
        "seconds": ca.if_else(swaps, seconds, s["seconds"]),
        "begins": ca.logic_and(ca.logic_not(refused), ca.logic_or(swaps, ca.logic_not(s["has_begun"]))),
        "last_tick": ca.if_else(swaps, NEVER, s["last_tick"]),
        "torque": ca.if_else(swaps, ca.DM(no_torque()), torque),
        "held": held,
        "held_now": ordered(held, SWAP_TORQUE, stance),
        "x": ca.vertcat(ordered(q, SWAP_STATE, stance), ordered(s["dq"], SWAP_STATE, stance)),
        "force": force,
    }
    return NumpyFunction.of("stand", s, outputs)


def tracking_function(robot: RobotNumbers, tracks: bool) -> NumpyFunction:
    """How far the stance foot has `moved` since it came down, m, and the `stone` in sight less that.

    `rate_error`: by how much angles contradict their rates, rad/s. Where they do, the foot moves in the angles alone.
    """
    sizes = {"x": 2 * DOF, "force": FORCES, "place": 2, "moved": 2, "carries": 1, "stone": 3, "stone_before": 3}
    s = symbols(sizes | {"rate_error": 1})
    carries = s["force"][1] > CARRIED
    feet = Feet(robot)
    stand = feet.function.function(s["x"][:DOF], *(ca.DM(np.ravel(lengths)) for lengths in feet.lengths))
    place = stand[feet.function.places["stance"][0]]
    moved = ca.if_else(ca.logic_and(carries, s["carries"]), s["moved"], place - s["place"])
    low, high = CONTRADICTED
    followed = within((high - s["rate_error"]) / (high - low)) * moved
    stone = s["stone"] - ca.vertcat(followed[0], followed[0], followed[1]) if tracks else s["stone"]
    outputs = {"moved": moved, "carries": carries} if tracks else {"moved": s["moved"], "carries": s["carries"]}
    outputs["stone"] = ca.if_else(is_finite(s["stone"]), stone, s["stone_before"])
    return NumpyFunction.of("tracking", s, outputs)


def tune_function() -> NumpyFunction:
    """The gains that depend on the identified robot."""
    names = "lateness", "disbelief", "eps", "doubt_eps", "torque_change_weight", "stone_margin", "late_margin"
    s = symbols(dict.fromkeys(names, 1))
    late, doubts = s["lateness"], s["disbelief"]
    outputs = {
        "eps": (1 - doubts) * s["eps"] + doubts * s["doubt_eps"],
        "torque_change_weight": late * s["torque_change_weight"],
        "stone_margin": s["stone_margin"] + late * s["late_margin"],
    }
    return NumpyFunction.of("tune", s, outputs)


class RabbitStep(StepFunctions):
    """The step of one controller of RABBIT; `gaits`: the numbers of a gait or library."""

    def __init__(
        self, walking: Walking, tick: Tick, parameters: ControllerParameters, robot: RobotNumbers, gaits: Gaits
    ) -> None:
        self._walking, self._tick, self._parameters, self._robot = walking, tick, parameters, robot
        self.identifies, self._on_stones = parameters.adaptation == "identification", parameters.terrain == "stones"
        self._after = after_tick(robot, parameters.doubt_eps > 0, parameters.tick_seconds) if self.identifies else None
        self.known = self._after.places if self._after else {}  # of the identified robot, in `known` of the memory
        self.seen, answering, left = tick_functions(walking, tick, parameters.tick_seconds)
        shape = Shape.of(gaits)
        first, begin = step_functions(shape, parameters.speed_regulation)
        self.steps = values_type(places_of(kept_at_first(GaitExpressions(shape), shape)))  # of `steps` in the memory
        self.gaits = gait_row(gaits)
        self._first = [np.array(output).ravel() for output in first(self.gaits)]
        steps = {"path": begin.numel_out("path"), "phase_scale": 2, "steps": begin.numel_out("steps_after"), "place": 2}
        steps |= {"moved": 2, "carries": 1, "has_begun": 1}
        known = sum(place.stop - place.start for place, _ in self.known.values())
        sizes = {"stance": 1, "index": 1, "start": 1, "seconds": 1, **steps, "stone": 3, "eps": 1, "last_tick": 1}
        make = find_kind(parameters.controller).compensation
        self.compensation = make(parameters) if make else None
        sizes |= {"adaptive": self.compensation.function.numel_in("adaptive")} if self.compensation else {}
        memory = Layout(sizes | {"left": left, "known": known, "torque": JOINTS, "held": JOINTS})
        self.declare(tick, answering, memory, Layout(READING), Layout(dict.fromkeys(SETTINGS, 1)))
        self.stand = self._stand()
        self.see = self._see(begin, Layout(steps))
        self.compose(SWAP_TORQUE)

    def first(self, parameters: ControllerParameters) -> Array:
        path, phase_scale, steps = self._first
        values: dict[str, Any] = {"seconds": np.nan, "carries": 1.0, "eps": parameters.eps, "last_tick": NEVER}
        values |= {"left": np.nan}
        values |= {"path": path, "phase_scale": phase_scale, "steps": steps, "torque": no_torque()}
        if self.identifies:
            values["known"] = np.concatenate([np.ravel(value) for value in first_known(self._robot).values()])
        row = np.zeros(self.memory.size)
        for name, value in values.items():
            row[self.memory.places[name][0]] = value
        return row

    def _stand(self) -> NumpyFunction:
        memory, reading, settings = self._columns
        offsets = memory["known"][self.known["offsets"][0]] if self.known else ca.DM.zeros(2)
        function = stand_function(self._walking, self._on_stones, self._parameters.tick_seconds)
        return row_function("stand", self._rows, call(function, {**memory, **settings, **reading, "offsets": offsets}))

    def _see(self, begin: ca.Function, steps: Layout) -> NumpyFunction:
        """`scene`, and in it what is `kept` for the next tick."""
        p, robot, walking, (memory, reading, settings) = self._parameters, self._robot, self._walking, self._columns
        stood_row = ca.MX.sym("stood", self.stand.row.size)
        stood, given = Layout.of(self.stand).parts(stood_row), {**self._rows, "stood": stood_row}
        begun_row = ca.MX.sym("begun", steps.size)
        begun = steps.parts(begun_row)
        nominal = ca.MX.sym("nominal", robot.row.size)  # as constants CasADi would fold them, and round otherwise
        numbers = {name: nominal[place] for name, (place, _) in places_of(robot_parameters()).items()}
        seen_now = {"x": stood["x"], "force": stood["force"], "stone": reading["stone"][1:]}
        was = {name: memory["known"][place] for name, (place, _) in self.known.items()}
        seen_now["rate_error"] = rate_error(was["errors"], was["differences"]) if was else ca.DM(0)
        tracking = tracking_function(robot, p.stone_tracking and self._on_stones)
        tracked = call(tracking, {**begun, **seen_now, "stone_before": memory["stone"]})
        if not self._on_stones:
            tracked["stone"] = memory["stone"]
        gains, follows = {name: settings[name] for name in GAINS}, stood["last_tick"] == reading["tick"] - 1
        x = stood["x"]
        if self._after:
            gains |= call(tune_function(), {**settings, **{name: was[name] for name in ("lateness", "disbelief")}})
            follows = ca.logic_and(follows, gains["eps"] == memory["eps"])  # else V has two gains
        if p.prediction:
            now = {"x": x, "robot": was["numbers"], "torque": stood["torque"], "lag": was["used"][LATE_TORQUE]}
            is_known = ca.fabs(ca.sum1(stood["torque"])) < ca.inf
            x = ca.if_else(is_known, call(prediction_function(window(p.tick_seconds)), now)["x"], x)
        named = {**gains, "phase_scale": begun["phase_scale"], "step_length": begun["steps"][0]}
        named |= dict(zip(("l_min", "l_max", "height"), ca.vertsplit(tracked["stone"]), strict=True))
        named |= {"force": stood["force"][:2], "held": stood["held_now"]}
        named |= {name: ca.DM.zeros(JOINTS) for name in walking.outputs.parameters if name not in named}  # of the path
        row = ca.vertcat(nominal, *(named[name] for name in walking.system.named if name in named))
        before = ca.if_else(follows, memory["left"], ca.DM.nan(memory["left"].numel()))
        seen_row = self.seen.function(x, row, begun["path"], stood["torque"], before)
        seen = Layout.of(self.seen).parts(seen_row)
        kept = {**begun, **tracked, "eps": gains["eps"], "last_tick": reading["tick"], "left": seen["leaves"]}
        kept |= {name: stood[name] for name in ("stance", "index", "start", "seconds")}
        kept |= {name: memory[name] for name in ("known", "adaptive") if name in memory}
        scene = {"seen": seen_row, "x": x} | {name: stood[name] for name in ("force", "torque", "stance", "index")}
        scene |= {name: reading[name] for name in ("tick", "touchdowns")}
        scene |= {"refused": stood["refused"], "step_time": (reading["tick"] - stood["start"]) * p.tick_seconds}
        if self._after:
            now = {**{name: stood[name] for name in ("x", "force", "torque")}, **numbers, "tick": reading["tick"]}
            known = call(self._after, now | {"known": memory["known"]})
            kept["known"] = ca.vertcat(*known.values())
            identified = ca.vertcat(known["numbers"], seen["p"][robot.row.size :])
            scene["adapted"] = model_error(self._tick.terms).function(x, seen["p"], identified)
            scene["identified"] = ca.vertcat(known["used"], known["offsets"], known["doubts"][0])
        self.kept = Layout({name: self.memory.sizes[name] for name in self.memory.sizes if name in kept})
        scene["kept"] = self.kept.joined(kept)
        seen_by = row_function("seen_by", {**given, "begun": begun_row, "nominal": nominal}, scene)
        as_one = seen_by.function.expand("as_one", {"cse": True})  # which computes nothing twice
        row = as_one(*given.values(), self._begun(begin, steps, stood), robot.row)
        inputs = {**self._rows, "gaits": self._gaits, "stood": stood_row}
        return NumpyFunction(ca.Function("see", [*inputs.values()], [row], [*inputs], ["values"]), seen_by.places)

    def _begun(self, begin: ca.Function, steps: Layout, stood: Mapping[str, ca.MX]) -> ca.MX:
        """What is known of this step: of the memory, or, where a step begins, by `begin`."""
        memory, reading, settings = self._columns
        robot = {name: ca.DM(getattr(self._robot, name).ravel()) for name in ("joints", "feet")}
        inputs = {**settings, **robot, "x": stood["x"], "seconds": stood["seconds"], "stone": reading["stone"][1:]}
        inputs |= {"steps": memory["steps"], "aim": settings["stone_aim"], "gaits": self._gaits}
        if not self._on_stones:
            inputs["stone"] = ca.DM.nan(3)
        arguments = [inputs[name] for name in begin.name_in()]
        symbols = [ca.MX.sym(name, value.numel()) for name, value in zip(begin.name_in(), arguments, strict=True)]
        before = ca.MX.sym("before", steps.size)
        path, phase_scale, after, place = begin(*symbols)
        new: dict[str, Any] = {"path": path, "phase_scale": phase_scale, "steps": after, "place": place}
        new |= {"moved": ca.DM.zeros(2), "carries": ca.DM(1), "has_begun": ca.DM(1)}
        begins = ca.Function("begins", [*symbols, before], [steps.joined(new)])
        goes_on = ca.Function("goes_on", [*symbols, before], [ca.MX(before)])
        either = ca.Function.if_else("begun", begins, goes_on)
        return either(stood["begins"], *arguments, steps.joined(memory))
