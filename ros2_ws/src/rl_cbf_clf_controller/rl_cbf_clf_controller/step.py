"""One tick of a controller as one function of rows of numbers:  memory, report = step(memory, reading, settings).

    stand    reading -> which leg stands, whether a step begins, the state in stance/swing order
    begin    what happens once a step: its path, where the stance foot stands (`step_begin.py`)
    see      scene: what is seen of the state, the identified robot, all of the QP that no estimate changes
    decide   scene, estimates -> the QP by DAQP, exploration, the torque within its limit

`step` is these four, one after another, with the identified robot's estimates or none. Where a policy is asked, it is
asked between `see` and `decide`. Where another solver is, it solves `data`, and `finish` does the rest of `decide`.
All are CasADi functions without a constant that may change as the robot walks; so they run in CasADi's virtual machine,
as C, for one robot or many, and always give the same bits.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.answer import TOLERANCE, by_daqp
from cbf_clf_qp.estimates import model_error
from cbf_clf_qp.functions import NumpyFunction, Place, values_type
from cbf_clf_qp.tick import Tick
from rabbit_description.state import DOF, JOINTS, SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, no_torque

from rl_cbf_clf_controller.identified_robot import after_tick, first_known
from rl_cbf_clf_controller.joint_calibration import OFFSETS
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.robot_numbers import Feet, RobotNumbers
from rl_cbf_clf_controller.state_prediction import prediction_function
from rl_cbf_clf_controller.tick_functions import tick_functions
from rl_cbf_clf_controller.walking import GAINS, Walking

NEVER = -2  # a tick that none follows
ROUNDING = 1e-6  # N m, by which the QP may be over the limit
CARRIED = 20.0  # N; a foot that presses less may be falling
FARTHEST_STONE, HIGHEST_STONE = 2.0, 0.5  # m; the latter up or down
READING = {
    **{"tick": 1, "q": DOF, "dq": DOF, "foot_force": 4, "contact": 2, "touchdowns": 1, "applied": JOINTS},
    **{"stone_index": 1, "stone": 3, "noise": JOINTS},
}
SETTINGS = ("swap_time", "swap_phase", "doubt_eps", "late_margin", *GAINS)
ESTIMATES = "alpha", "beta", "output_error"
# why a state is refused, or an episode must end
Q, DQ, STONE = 1, 2, 3
DISAGREEMENT, UNSOLVED, NOT_FINITE = 1, 2, 3


class Layout:
    """A row of numbers by name: how many of each, in order."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self.sizes = dict(sizes)
        self.places, self.size = dict[str, Place](), 0
        for name, size in sizes.items():
            self.places[name] = slice(self.size, self.size + size), (size,)
            self.size += size
        self.values = values_type(self.places)  # of a row, by name

    def symbols(self, name: str) -> tuple[ca.MX, dict[str, ca.MX]]:
        """A row, and its parts."""
        row = ca.MX.sym(name, self.size)
        return row, {part: row[place] for part, (place, _) in self.places.items()}

    def joined(self, values: Mapping[str, Any]) -> ca.MX:
        """A row of these parts."""
        return ca.vertcat(*(values[name] for name in self.sizes))


def call(function: NumpyFunction, values: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """What a function gives of the inputs that it names, by name; a matrix as a column, row by row."""
    row = function.function(*(values[name] for name in function.function.name_in()))
    return {name: row[place] for name, (place, _) in function.places.items()}


def made(name: str, inputs: Mapping[str, ca.MX], outputs: Mapping[str, ca.MX]) -> NumpyFunction:
    """A function of columns that gives a row."""
    layout = Layout({name: value.numel() for name, value in outputs.items()})
    function = ca.Function(name, [*inputs.values()], [layout.joined(outputs)], [*inputs], ["values"])
    return NumpyFunction(function, layout.places)


def symbols(sizes: Mapping[str, int]) -> dict[str, ca.SX]:
    """Columns of these sizes."""
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


def stand_function(walking: Walking, on_stones: bool) -> NumpyFunction:
    """Which leg stands, and the state in stance/swing order, of memory, reading and settings; see the module."""
    sizes = {"stance": 1, "index": 1, "start": 1, "seconds": 1, "has_begun": 1, "last_tick": 1, "phase_scale": 2}
    sizes |= {"torque": JOINTS, "held": JOINTS, "offsets": 2, "swap_time": 1, "swap_phase": 1}
    s = symbols({**sizes, **{name: READING[name] for name in READING if name != "noise"}})
    q = s["q"] - ca.DM(OFFSETS) @ s["offsets"]
    tick, is_right = s["tick"], s["stance"]
    is_known = is_finite(s["applied"])
    held = ca.if_else(is_known, s["applied"], s["held"])
    torque = ca.if_else(is_known, ordered(s["applied"], SWAP_TORQUE, is_right), s["torque"])
    seconds = (tick - s["start"]) * TICK_SECONDS
    phase_of = [walking.robot.q, walking.outputs.parameters["phase_scale"]]
    (in_phase,) = ca.substitute([walking.outputs.phase], phase_of, [ordered(q, SWAP_STATE, is_right), s["phase_scale"]])
    down = ca.if_else(is_right, s["contact"][0], s["contact"][1])
    swaps = ca.logic_and(down, ca.logic_and(seconds > s["swap_time"], in_phase > s["swap_phase"]))
    stance = ca.if_else(swaps, 1 - is_right, is_right)
    refused = ca.if_else(is_finite(s["q"]), ca.if_else(is_finite(s["dq"]), 0, DQ), Q)
    if on_stones:
        near, far, height = s["stone"][0], s["stone"][1], s["stone"][2]
        is_stone = ca.logic_and(s["stone_index"] == s["touchdowns"] + 1, ca.fabs(height) <= HIGHEST_STONE)
        is_stone = ca.logic_and(is_stone, ca.logic_and(ca.logic_and(near > 0, near < far), far < FARTHEST_STONE))
        refused = ca.if_else(refused, refused, ca.if_else(is_stone, 0, STONE))
    force = ca.if_else(stance, s["foot_force"][[2, 3, 0, 1]], s["foot_force"])
    found = {
        "refused": refused,
        "stance": stance,
        "index": s["index"] + swaps,
        "start": ca.if_else(swaps, tick, s["start"]),
        "seconds": ca.if_else(swaps, seconds, s["seconds"]),
        "begins": ca.logic_or(swaps, ca.logic_not(s["has_begun"])),
        "last_tick": ca.if_else(swaps, NEVER, s["last_tick"]),
        "torque": ca.if_else(swaps, ca.DM(no_torque()), torque),
        "held": held,
        "held_now": ordered(held, SWAP_TORQUE, stance),
        "x": ca.vertcat(ordered(q, SWAP_STATE, stance), ordered(s["dq"], SWAP_STATE, stance)),
        "force": force,
    }
    return NumpyFunction.of("stand", s, found)


def is_finite(values: ca.SX) -> ca.SX:
    """1 where all of a few numbers are, and their sum, else 0."""
    return ca.fabs(ca.sum1(values)) < ca.inf


def ordered(values: ca.SX, swapped: Any, is_right: ca.SX) -> ca.SX:
    """From left/right to stance/swing order, or back."""
    return ca.if_else(is_right, values[swapped.tolist()], values)


def tracking_function(robot: RobotNumbers, tracks: bool) -> NumpyFunction:
    """How far the stance foot has `moved` since it came down, m, and the `stone` in sight less that."""
    s = symbols({"x": 2 * DOF, "force": 4, "place": 2, "moved": 2, "carries": 1, "stone": 3, "stone_before": 3})
    carries = s["force"][1] > CARRIED
    feet = Feet(robot)
    stand = feet.function.function(s["x"][:DOF], *(ca.DM(np.ravel(each)) for each in feet.lengths))
    place = stand[feet.function.places["stance"][0]]
    moved = ca.if_else(ca.logic_and(carries, s["carries"]), s["moved"], place - s["place"])
    stone = s["stone"] - ca.vertcat(moved[0], moved[0], moved[1]) if tracks else s["stone"]
    found = {"moved": moved, "carries": carries} if tracks else {"moved": s["moved"], "carries": s["carries"]}
    found["stone"] = ca.if_else(is_finite(s["stone"]), stone, s["stone_before"])
    return NumpyFunction.of("tracking", s, found)


def tune_function(parameters: ControllerParameters) -> NumpyFunction:
    """Gains that depend on the identified robot, see `IdentifiedRobots.tune`."""
    names = "lateness", "disbelief", "eps", "doubt_eps", "torque_change_weight", "stone_margin", "late_margin"
    s = symbols(dict.fromkeys(names, 1))
    late, doubts = s["lateness"], s["disbelief"]
    found = {
        "eps": (1 - doubts) * s["eps"] + doubts * s["doubt_eps"],
        "torque_change_weight": late * s["torque_change_weight"],
        "stone_margin": s["stone_margin"] + late * s["late_margin"],
    }
    return NumpyFunction.of("tune", s, found)


def act_function() -> NumpyFunction:
    """What was decided, with exploration, within the torque limit."""
    sizes = {"residual": 1, "tolerance": 1, "mu": JOINTS, "u": JOINTS, "control_a": JOINTS**2, "control_b": JOINTS}
    sizes |= {"noise": JOINTS, "torque_limit": 1, "stance": 1, "index": 1, "touchdowns": 1}
    s = symbols(sizes)
    solved, limit = s["residual"] < s["tolerance"], s["torque_limit"]
    a, b = ca.reshape(s["control_a"], JOINTS, JOINTS).T, s["control_b"]
    mu_qp = ca.if_else(solved, s["mu"], 0)
    explores = ca.mmax(ca.fabs(s["noise"])) > 0
    mu = ca.if_else(explores, mu_qp + s["noise"], mu_qp)
    wanted = ca.if_else(explores, a @ mu + b, ca.if_else(solved, s["u"], b))
    largest = ca.mmax(ca.fabs(wanted))
    torque = ca.fmin(ca.fmax(wanted, -limit), limit)
    saturated = largest > limit + ROUNDING
    mu = ca.if_else(saturated, ca.solve(a, torque - b), mu)
    sound = ca.logic_and(is_finite(wanted), ca.logic_and(is_finite(torque), is_finite(mu)))
    fault = ca.if_else(sound, ca.if_else(solved, 0, UNSOLVED), ca.if_else(solved, NOT_FINITE, UNSOLVED))
    fault = ca.if_else(s["touchdowns"] != s["index"], DISAGREEMENT, fault)
    torque, mu, mu_qp = (ca.if_else(sound, each, 0) for each in (torque, mu, mu_qp))
    found = {"stance_torque": torque, "command": ordered(torque, SWAP_TORQUE, s["stance"]), "mu": mu, "mu_qp": mu_qp}
    found |= {"saturated": ca.logic_and(saturated, sound), "solved": solved, "fault": fault, "wanted": wanted}
    return NumpyFunction.of("act", s, found)


class StepFunctions:
    """The functions of a tick, see the module, of one controller; `memory` and `scene` are rows with these layouts.

    `step` gives memory and report in one row, `places` says what lies where.
    """

    def __init__(self, walking: Walking, tick: Tick, parameters: ControllerParameters, robot: RobotNumbers) -> None:
        p, system = parameters, walking.system
        self.identifies, on_stones = p.adaptation == "identification", p.terrain == "stones"
        look, answering, left = tick_functions(walking, tick)
        n, m = len(tick.names), tick.terms.inputs
        known = first_known(robot) if self.identifies else {}
        sizes = {
            "stance": 1,
            "index": 1,
            "start": 1,
            "seconds": 1,
            "has_begun": 1,
            "place": 2,
            "moved": 2,
            "carries": 1,
        }
        sizes |= {"path": look.function.numel_in("path"), "phase_scale": 2, "step_length": 1, "stone": 3, "eps": 1}
        sizes |= {"last_tick": 1, "torque": JOINTS, "held": JOINTS, "left": left}
        sizes |= {"known": sum(value.size for value in known.values())}
        self.memory = Layout(sizes)
        self.reading, self.settings = Layout(READING), Layout(dict.fromkeys(SETTINGS, 1))
        self.estimate_sizes = {"alpha": n * m, "beta": n, "output_error": m * (m + 1)}
        error = model_error(tick.terms)
        memory_row, memory = self.memory.symbols("memory")
        reading_row, reading = self.reading.symbols("reading")
        settings_row, settings = self.settings.symbols("settings")

        # stand
        offsets = ca.DM.zeros(2)
        after = after_tick(robot, p.doubt_eps > 0) if self.identifies else None
        self.known = after.places if after else {}  # of the identified robot, in `known` of the memory
        if after:
            was = {name: memory["known"][place] for name, (place, _) in after.places.items()}
            offsets = was["offsets"]
        now = call(stand_function(walking, on_stones), {**memory, **settings, **reading, "offsets": offsets})
        self.stand = made("stand", {"memory": memory_row, "reading": reading_row, "settings": settings_row}, now)

        # see, once the step has begun
        stood_row, stood = Layout({name: value.numel() for name, value in now.items()}).symbols("stood")
        numbers = {name: settings[name] for name in GAINS}
        x, before, new = stood["x"], memory["left"], ca.DM.nan(left)
        follows = stood["last_tick"] == reading["tick"] - 1
        if after:
            tuned = call(tune_function(p), {**settings, **{name: was[name] for name in ("lateness", "disbelief")}})
            numbers |= tuned
            follows = ca.logic_and(follows, tuned["eps"] == memory["eps"])
        before = ca.if_else(follows, memory["left"], new)
        about_stone = {
            **memory,
            "x": x,
            "force": stood["force"],
            "stone": reading["stone"],
            "stone_before": memory["stone"],
        }
        tracked = call(tracking_function(robot, p.stone_tracking and on_stones), about_stone)
        if not on_stones:
            tracked["stone"] = memory["stone"]
        seen_x = x
        if after and p.prediction:
            given = {"x": x, "robot": was["numbers"], "torque": stood["torque"], "lag": was["used"][-1]}
            ahead = call(prediction_function(), given)["x"]
            seen_x = ca.if_else(ca.fabs(ca.sum1(stood["torque"])) < ca.inf, ahead, x)
        numbers |= {name: ca.DM.zeros(value.numel()) for name, value in walking.outputs.parameters.items()}
        robot_row, places = ca.DM(robot.row), [*system.named]
        given = {**numbers, "phase_scale": memory["phase_scale"], "step_length": memory["step_length"]}
        stone = dict(zip(("l_min", "l_max", "height"), ca.vertsplit(tracked["stone"]), strict=True))
        given |= stone | {"force": stood["force"][:2], "held": stood["held_now"]}
        own = [name for name in places if name not in given]
        assert places[: len(own)] == own  # the robot's numbers come first
        rest = ca.vertcat(*(given[name] for name in places[len(own) :]))
        p_row = ca.vertcat(robot_row, rest)
        inputs = {"x": seen_x, "p": p_row, "path": memory["path"], "torque": stood["torque"], "before": before}
        seen = call(look, inputs)
        self.seen, self.read, self.programme = look, answering.reading, answering.programme
        kept = {
            "eps": numbers["eps"],
            "stone": tracked["stone"],
            "moved": tracked["moved"],
            "carries": tracked["carries"],
        }
        kept |= {"last_tick": reading["tick"], "left": seen["leaves"]}
        kept |= {name: stood[name] for name in ("stance", "index", "start", "seconds", "held")} | {
            "has_begun": ca.DM(1)
        }
        scene = {
            "seen": look.function(*inputs.values()),
            "x": seen_x,
            "force": stood["force"],
            "torque": stood["torque"],
        }
        scene |= {"stance": stood["stance"], "index": stood["index"], "refused": stood["refused"]}
        scene["step_time"] = (reading["tick"] - stood["start"]) * TICK_SECONDS
        if after:
            tick_now = {"known": memory["known"], "tick": reading["tick"], "x": x, "force": stood["force"]}
            lengths = {"joints": ca.DM(robot.joints.ravel()), "feet": ca.DM(robot.feet.ravel())}
            row = after.function(
                *({**tick_now, "torque": stood["torque"], **lengths}[name] for name in after.function.name_in())
            )
            kept["known"] = row
            is_now = {name: row[place] for name, (place, _) in after.places.items()}
            other = ca.vertcat(is_now["numbers"], seen["p"][robot.row.size :])  # with what the path desires
            found = call(error, {"x": seen_x, "p": seen["p"], "other": other})
            scene |= {f"identified_{name}": found[name] for name in ESTIMATES}
            scene["identified"] = ca.vertcat(is_now["used"], is_now["offsets"], is_now["doubts"][0])
        else:
            kept["known"] = memory["known"]
        kept |= {name: memory[name] for name in ("place", "path", "phase_scale", "step_length")}
        self.kept = Layout({name: size for name, size in sizes.items() if name not in ("torque", "held")})
        scene["kept"] = self.kept.joined(kept)
        arguments = {"memory": memory_row, "reading": reading_row, "settings": settings_row, "stood": stood_row}
        self.see = made("see", arguments, scene)
        self._decide(answering, settings_row, settings, reading_row, reading)

    def _decide(self, answering: Any, settings_row: ca.MX, settings: Any, reading_row: ca.MX, reading: Any) -> None:
        """The functions after the estimates: `data` of the QP, `finish` with an answer to it, `decide` with DAQP's."""
        self.scene = Layout({name: place.stop - place.start for name, (place, _) in self.see.places.items()})
        scene_row, scene = self.scene.symbols("scene")
        estimates = {name: ca.MX.sym(name, size) for name, size in self.estimate_sizes.items()}
        given = {**estimates, "prepared": scene["seen"][self.seen.places["prepared"][0]]}
        programme = answering.programme
        self.data = made("data", {"scene": scene_row, **estimates}, call(programme, given))
        data_row = ca.MX.sym("data", programme.row.size)
        x, y = (
            ca.MX.sym("x", answering.reading.function.numel_in("x")),
            ca.MX.sym("y", answering.reading.function.numel_in("y")),
        )
        answer_row = answering.reading.function(data_row, x, y)
        answer = {name: answer_row[place] for name, (place, _) in answering.reading.places.items()}
        tolerance = ca.MX.sym("tolerance")
        acted = call(act_function(), {**settings, **reading, **scene, **answer, "tolerance": tolerance})
        kept = {name: scene["kept"][place] for name, (place, _) in self.kept.places.items()}
        memory = self.memory.joined({**kept, "torque": acted["stance_torque"], "held": acted["command"]})
        report = {"memory": memory, **acted, "answer": answer_row}
        inputs = {"reading": reading_row, "settings": settings_row, "scene": scene_row}
        self.finish = made("finish", {**inputs, "data": data_row, "x": x, "y": y, "tolerance": tolerance}, report)
        data = self.data.function(scene_row, *estimates.values())
        solution = by_daqp(data, programme.places)
        row = self.finish.function(*inputs.values(), data, *solution, TOLERANCE)
        function = ca.Function(
            "decide", [*inputs.values(), *estimates.values()], [row], [*inputs, *estimates], ["values"]
        )
        self.decide = NumpyFunction(function, self.finish.places)
        memory_row = ca.MX.sym("memory", self.memory.size)
        start = {"memory": memory_row, "reading": reading_row, "settings": settings_row}
        stood = self.stand.function(*start.values())
        seen = self.see.function(*start.values(), stood)
        known = {name: ca.DM.zeros(size) for name, size in self.estimate_sizes.items()}
        if self.identifies:
            known = {name: seen[self.scene.places[f"identified_{name}"][0]] for name in ESTIMATES}
        row = ca.vertcat(seen, self.decide.function(reading_row, settings_row, seen, *known.values()))
        self.acted = Layout({name: place.stop - place.start for name, (place, _) in self.finish.places.items()})
        self.report = Layout(self.scene.sizes | self.acted.sizes)
        self.step = NumpyFunction(
            ca.Function("step", [*start.values()], [row], [*start], ["values"]), self.report.places
        )
