"""Online adaptation: the true robot is identified as it walks, and what that changes enters the QP as alpha and beta.

`identification.py` finds what the robot weighs, how its joints are damped and what its motors give;
`joint_calibration.py` where its joints' angles are zero. A second model carries what is found, and the estimates are
the difference of the quantities by this and by the nominal model, as the oracle's are by the plant's
(`cbf_clf_qp.estimates`). The policy's are added to them. The angles are corrected before anything is computed from
them. Where the state is predicted (`state_prediction.py`), the identification still learns from the measured one.

The identification goes by windows of 10 ms, of one tick or of several (`identification.py`). It uses a window only if
the stance foot was the only one on the ground, and had been for SETTLING windows. So it leaves out that of a touchdown,
flight, a swing foot on the ground, a missing tick, an unknown torque. (A foot that bounces lands twice.) It forgets
nothing when the legs swap: the robot is the same from either leg. An episode begins with nothing known, and with some
windows in which only the noise of the rates is found.

That noise is found from the torso's pitch. The mean of the rates at a window's ends, each with an error of variance
sigma^2, less the pitch's change over the window, has the variance sigma^2 / 2: its size is sigma / sqrt(pi) in the
mean. Hardly anything of the motion itself is left in it, for the angle says what the rate was. A second difference of
rates would not do: torques that chatter look like noise in it. An error above PUSHED is a push.

No masses explain a motor that saturates unseen. As far as the innovations say so, the robot found gives way to the one
that the base's rows say or to the nominal one (`identification.py`).
"""

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import NumpyFunction, packed
from cbf_clf_qp.qp import is_bounded
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import DOF, JOINTS, TICK_SECONDS, Array, no_torque
from rabbit_description.tick import ticks_in

from rl_cbf_clf_controller.identification import (
    DAMPING,
    IDENTIFIED,
    LATE_TORQUE,
    MOTOR_GAIN,
    RATE_NOISE,
    THETA,
    WINDOW,
    in_use,
    lateness,
    learned,
    unknown,
    window,
)
from rl_cbf_clf_controller.joint_calibration import UNKNOWN, calibrated
from rl_cbf_clf_controller.planar_robot import INERTIAL, robot_parameters
from rl_cbf_clf_controller.robot_numbers import RobotNumbers

KNOWN = (*IDENTIFIED, "hip_offset", "knee_offset", "doubt")  # offsets in rad
SETTLING = 2  # windows on the ground before what is measured counts
PITCH = SLIDES  # its place in the state; its rate is DOF further
CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air
PUSHED = 0.3  # rad/s, at which an error is cut: a push
NOISE_WEIGHT = 60.0  # of the rates' measured variance: noise in the regressors does not average out
FITS = "fit", "covariance", "base_fit", "base_covariance"  # which stay by themselves where nothing is learned
FIRST_DIFFERENCES = 3  # before which nothing is known


def first_known(nominal: RobotNumbers) -> dict[str, Array]:
    """What is known of a robot as an episode begins: of `identification.unknown`, of `joint_calibration.UNKNOWN`, more.

    `used` (15,) and `numbers`, its row: the robot that is used, with its `lateness` and its `disbelief`; `errors` and
    number of the `differences` between mean rate and pitch; for how many windows the stance foot alone is `standing`;
    `torque`: mean of the last window; of the present one, of so many `ticks`, its `start` and the sums of torques and
    forces; `tick` and `x` of the last tick.
    """
    known, nothing = unknown(nominal), np.zeros(1)
    used = {"used": known["value"], "numbers": nominal.row, "lateness": nothing, "disbelief": nothing}
    noise = dict.fromkeys(("errors", "differences", "standing"), nothing)
    sums = {"ticks": nothing, "start": np.zeros(2 * DOF), "torques": np.zeros(JOINTS), "forces": np.zeros((2, 2))}
    last = {"tick": np.full(1, -2), "torque": no_torque(), "x": np.zeros(2 * DOF)}
    return {**known, **UNKNOWN, **used, **noise, **sums, **last}


def after_tick(nominal: RobotNumbers, gives_way: bool, tick_seconds: float = TICK_SECONDS) -> NumpyFunction:
    """What is known after a tick, by the names of `first_known`, of (what was known; number, state, force and torque as
    it ends; joints, feet)."""
    first, length, seconds = first_known(nominal), ticks_in(WINDOW, tick_seconds), window(tick_seconds)
    shapes = {name: value.shape if value.ndim == 2 else (value.size, 1) for name, value in first.items()}
    known = {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}
    sizes = {"tick": (1, 1), "x": (2 * DOF, 1), "force": (2, 2), "torque": (JOINTS, 1)}
    now = {name: ca.SX.sym(name, *shape) for name, shape in sizes.items()}
    lengths = {"joints": ca.SX.sym("joints", JOINTS, 2), "feet": ca.SX.sym("feet", 2, 2)}
    stance, swing = now["force"][0, 1], now["force"][1, 1]
    follows = ca.logic_and(known["tick"] + 1 == now["tick"], is_bounded(now["torque"]))
    pinned = ca.logic_and(follows, ca.logic_and(swing < CONTACT_FORCE, stance >= CONTACT_FORCE))
    begins = ca.logic_or(known["ticks"] == 0, known["ticks"] == length)
    start = ca.if_else(begins, known["x"], known["start"])
    sums = {"torques": now["torque"], "forces": now["force"]}
    sums = {name: ca.if_else(begins, value, known[name] + value) for name, value in sums.items()}
    ticks = pinned * (ca.if_else(begins, 0, known["ticks"]) + 1)
    is_whole = ticks == length
    standing = pinned * (known["standing"] + is_whole)
    learns = ca.logic_and(is_whole, standing > SETTLING)
    torque, force = sums["torques"] / length, sums["forces"] / length
    turned, rates = now["x"][PITCH] - start[PITCH], now["x"][DOF + PITCH] + start[DOF + PITCH]
    error = ca.fabs(rates / 2 - turned / seconds)
    errors = known["errors"] + ca.if_else(learns, ca.fmin(error, PUSHED), 0)
    differences = known["differences"] + learns
    offsets = calibrated(known, now["x"], differences, np.pi * (errors / differences) ** 2, **lengths)
    after = {name: ca.if_else(learns, value, known[name]) for name, value in offsets.items()}
    after |= {"errors": errors, "differences": differences, "standing": standing}
    tick = {"start": start, "end": now["x"], "before": known["torque"], "now": torque, **lengths}
    tick |= {"force": force, "rate_variance": rate_variance(errors, differences)}
    tick["learns"] = is_known = ca.logic_and(learns, differences >= FIRST_DIFFERENCES)
    later = learned(nominal, known, tick, seconds)
    value, base, doubts = later["value"], later["base"], later["doubts"]
    used, disbelief = in_use(value, base, first["value"], doubts) if gives_way else (value, ca.SX(0))
    later |= {"used": used, "lateness": lateness(used[LATE_TORQUE]), "disbelief": disbelief}
    later["numbers"] = with_links(nominal, used)
    kept = known | {name: ca.if_else(pinned, known[name], first[name]) for name in ("regressor", "measured", "share")}
    after |= {name: value if name in FITS else ca.if_else(is_known, value, kept[name]) for name, value in later.items()}
    after |= {**sums, "ticks": ticks, "start": start, "tick": now["tick"], "x": now["x"]}
    after["torque"] = ca.if_else(is_whole, torque, known["torque"])
    inputs, outputs = {"known": packed(known), **now, **lengths}, {name: after[name] for name in first}
    return NumpyFunction.of("after_tick", inputs, outputs)


def rate_error(errors: ca.SX, differences: ca.SX) -> ca.SX:
    """Mean difference between the pitch's mean rate and its change, rad/s; 0 before enough of it is known."""
    return ca.if_else(differences >= FIRST_DIFFERENCES, errors / ca.fmax(differences, 1), 0)


def rate_variance(errors: ca.SX, differences: ca.SX) -> ca.SX:
    """The variance of the rates' errors, (m/s)^2 and (rad/s)^2, as the identification takes it.

    That without noise, of what a tick's mean leaves out, is in it. What is measured counts many times, because the
    regressors have the same noise: it pulls the masses towards none, however long the walk.
    """
    return RATE_NOISE**2 + NOISE_WEIGHT * np.pi * (errors / differences) ** 2


def with_links(nominal: RobotNumbers, used: ca.SX) -> ca.SX:
    """The `nominal` robot's row with two like legs of these links, motors and joints, (15,)."""
    torso, thigh, shin = ca.horzsplit(ca.reshape(used[THETA], len(INERTIAL), 3))
    numbers = {name: ca.SX(ca.DM(getattr(nominal, name))) for name in robot_parameters()}
    numbers |= {"links": ca.horzcat(torso, thigh, shin, thigh, shin).T, "joint_damping": used[DAMPING]}
    return packed({**numbers, "motor_gain": ca.repmat(used[MOTOR_GAIN], JOINTS, 1)})
