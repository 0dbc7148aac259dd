"""What happens once a step, at the touchdown that it begins with, as two CasADi functions of which C can be made.

    first(gaits)                                                            -> path, phase_scale, steps_after
    begin(x, stone, seconds, steps, gaits, aim, joints, feet, slope_change) -> path, phase_scale, steps_after, place

`first` is of an episode. A step of a library goes from length A into length B: A is where the feet stand at the
touchdown, B what the previewed stone asks for. With gaits for several slopes the speed is regulated by the slope that a
step is made for (`speed_regulation.py`). `step_paths.py` has the path from A into B on that slope, `step_landing.py`
how it ends on its stone, and goes on where there is no ground. A single gait's path is the same in every step.

The touchdown leaves the joints beside the path, at y_0 and y_0'. So that the step begins without error, the desired
outputs are

    y_d(s) = path(s) + (1 - x)^3 (a + b x)    for x = (s - s_0) / w < 1,  s_0: the phase at the touchdown,  w: width

with a = y_0 and b = w y_0' / s_0' + 3 a: then y = y' = 0 at s_0, and y_d'' is continuous where the correction ends.
Before s_0 its curvature fades as in `virtual_constraints.py`. At the first tick of a step s is s_0 but for rounding, so
nothing may jump there.
"""

import casadi as ca
from cbf_clf_qp.functions import packed, row_major
from cbf_clf_qp.qp import is_bounded
from rabbit_description.state import DOF

from rl_cbf_clf_controller import speed_regulation
from rl_cbf_clf_controller.speed_regulation import Expressions, clipped, regulated
from rl_cbf_clf_controller.step_landing import Legs, descent, landing_at
from rl_cbf_clf_controller.step_paths import CONTROLLED, PHASE_ANGLE, GaitExpressions, PathExpressions, Shape
from rl_cbf_clf_controller.virtual_constraints import continued

FADED = 0.5  # phase at which the correction ends
FADED_ON_SLOPES = 0.7  # of steps whose slope differs from the last one's: their corrections are larger
LEAST_WIDTH = 0.1  # of the phase, of a correction that begins late
HIGHER = 0.003  # m, above what a preview says: a foot that is met too early by its stone meets the stone's side
LEAST_RATE = 0.5  # 1/s; of a robot that hardly moves forward, y' is not made continuous


class Touchdown:
    """Symbols for what a step begins with, (n,), see `step_functions`."""

    def __init__(self) -> None:
        self.x, self.stone = ca.SX.sym("x", 2 * DOF), ca.SX.sym("stone", 3)
        self.seconds, self.aim, self.slope_change = map(ca.SX.sym, ("seconds", "aim", "slope_change"))
        self.legs = Legs()

    @property
    def taken(self) -> ca.SX:
        """How far apart the feet stand, m."""
        return -self.legs.swing(self.x[:DOF])[0][0]

    @property
    def sees(self) -> ca.SX:
        """Whether there is a stone."""
        return is_bounded(self.stone)


def step_functions(shape: Shape, regulation: str = "learned") -> tuple[ca.Function, ca.Function]:
    """`first` and `begin`, of columns; matrices are row by row. `regulation`: learned or integral.

    Into `begin` go the state `x` (14,) at the touchdown, stance/swing order; `stone` (3,): l_min, l_max, height from
    the stance foot, m, NaN where there is none; `seconds` that the last step took, NaN before the first; `steps`: what
    is kept, see `kept_at_first`; `gaits`, see `gait_row`; `aim`: the share of the stone's width that a step goes to;
    `joints` (8,), `feet` (4,) of the robot, m; and `slope_change`, degrees, that is added to the slope that the
    regulation chooses, to explore.

    Out come `path` and `phase_scale`, see `PathExpressions`; `steps_after`; and `place` (2,) of the stance foot in the
    world, m.
    """
    gaits, now = GaitExpressions(shape), Touchdown()
    row, start = packed(gaits.symbols), kept_at_first(gaits, shape)
    path = gaits.path(gaits.start_length, gaits.start_length, start["slopes"][0])
    outputs = {"path": path.row(), "phase_scale": path.scale, "steps_after": packed(start)}
    first = ca.Function("first", [row], [*outputs.values()], ["gaits"], [*outputs], {"cse": True})
    kept = {name: ca.SX.sym(name, *value.shape) for name, value in start.items()}
    inputs = {"x": now.x, "stone": now.stone, "seconds": now.seconds, "steps": packed(kept), "gaits": row}
    inputs |= {"aim": now.aim, "joints": row_major(now.legs.joints), "feet": row_major(now.legs.feet)}
    inputs |= {"slope_change": now.slope_change}
    if shape.is_single:
        outputs["steps_after"] = inputs["steps"]
    else:
        after = chosen(kept, gaits, now, regulation if shape.slopes > 1 else None)
        path, down, faded = gaits.path(now.taken, after["wanted"], after["slopes"][0]), None, FADED
        if shape.slopes > 1:
            path = landing_at(path, ca.if_else(now.sees, now.stone[2] + HIGHER, 0), now.legs)
            down, faded = descent(path, now.legs), FADED_ON_SLOPES
        outputs = {"path": path.row(*corrected(path, now.x, faded), down), "phase_scale": path.scale}
        outputs["steps_after"] = packed(after)
    outputs["place"] = now.legs.stance(now.x[:DOF])
    begin = ca.Function("begin", [*inputs.values()], [*outputs.values()], [*inputs], [*outputs], {"cse": True})
    return first, begin


def kept_at_first(gaits: GaitExpressions, shape: Shape) -> dict[str, ca.SX]:
    """What is kept from step to step, as an episode begins: `wanted`, the length of the present step, m, 0 of a single
    gait; and what the regulation of the speed keeps."""
    wanted = ca.SX(0) if shape.is_single else gaits.start_length
    return {"wanted": wanted, **speed_regulation.level(*gaits.slope_range)}


def chosen(kept: Expressions, gaits: GaitExpressions, now: Touchdown, regulation: str | None) -> dict[str, ca.SX]:
    """What is kept after a touchdown: the length of the next step, and its slope if there is a `regulation`."""
    after = dict(kept)
    if regulation:
        speed = now.taken / now.seconds - gaits.speed(kept["wanted"])
        missing = gaits.start_rate(now.taken, kept["slopes"][0]) - PHASE_ANGLE @ now.x[DOF:]
        new = regulated(kept, *gaits.slope_range, missing, speed, regulation)
        new["slopes"][0] = clipped(new["slopes"][0] + now.slope_change, *gaits.slope_range)
        has_walked = is_bounded(now.seconds)
        after = {name: ca.if_else(has_walked, new[name], value) for name, value in kept.items()}
    on_stone = gaits.within(now.stone[0] + now.aim * (now.stone[1] - now.stone[0]))
    return after | {"wanted": ca.if_else(now.sees, on_stone, kept["wanted"])}


def corrected(path: PathExpressions, x: ca.SX, faded: float) -> tuple[ca.SX, ca.SX]:
    """Correction in powers (m, CORRECTION_POWERS), and its span (2,): y and y' of the path, made zero at `x` (2 n,).

    From the phase `faded` on there is none.
    """
    q, dq = x[:DOF], x[DOF:]
    phase = path.scale[0] * (PHASE_ANGLE @ q) - path.scale[1]
    rate = path.scale[0] * (PHASE_ANGLE @ dq)
    value, slope, _ = continued(path.powers, phase)
    a, dy = CONTROLLED @ q - value, CONTROLLED @ dq - slope * rate
    width = ca.fmax(faded - phase, LEAST_WIDTH)
    r = width * dy / ca.fmax(rate, LEAST_RATE)  # b - 3 a
    return ca.horzcat(a, r, -6 * a - 3 * r, 8 * a + 3 * r, -3 * a - r), ca.vertcat(phase, width)
