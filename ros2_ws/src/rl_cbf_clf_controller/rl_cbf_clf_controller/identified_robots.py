"""N identified robots of a batch: to the bit what `IdentifiedRobot` finds of each, with its functions of all at once.

What a robot has learned lies in the rows of `_known`; a tick that a robot does not learn from leaves its row as it is.
"""

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction, places_of
from rabbit_description.state import DOF, Array, no_torque

from rl_cbf_clf_controller.batch_functions import BatchFunction
from rl_cbf_clf_controller.identification import (
    DAMPING,
    LATE_TORQUE,
    MOTOR_GAIN,
    RATE_NOISE,
    SHARE,
    THETA,
    disbelief,
    in_use,
    is_physical,
    lateness,
)
from rl_cbf_clf_controller.identification import SIZE as IDENTIFIED
from rl_cbf_clf_controller.identified_robot import CONTACT_FORCE, PITCH_RATE, SETTLING, IdentifiedRobot
from rl_cbf_clf_controller.joint_calibration import OFFSETS
from rl_cbf_clf_controller.planar_robot import INERTIAL, robot_parameters
from rl_cbf_clf_controller.rate_noise import CORRELATED, FIRST_DIFFERENCES, PER_VARIANCE

FITS = "fit", "covariance", "walk", "base_fit", "base_covariance"
PLACES = {name: place for name, (place, _) in places_of(robot_parameters()).items()}


class IdentifiedRobots:
    """See `IdentifiedRobot`, whose nominal robot and functions `one` gives, and `Controller._error`."""

    def __init__(self, one: IdentifiedRobot, model_error: NumpyFunction, robots: int) -> None:
        identification, calibration = one._identification, one._calibration
        one.reset()
        self._nominal, self._gives_way, self._start = one._row, one._gives_way, identification.nominal
        self._identify, self._calibrate = BatchFunction(identification._learned), BatchFunction(calibration._learned)
        self._predict, self._model_error = BatchFunction(one._predicted), BatchFunction(model_error)
        self._first = {
            **{"joints": one._nominal.joints.ravel(), "feet": one._nominal.feet.ravel()},
            **{"value": identification.value, "fit": identification.value},  # taken over, and as the squares say
            **{"used": identification.value},  # see `identification.in_use`
            **{"covariance": identification._fit.covariance.ravel(), "walk": identification._fit.walk.ravel()},
            **{"base": identification.base, "base_fit": identification._base_fit.value},
            **{"base_covariance": identification._base_fit.covariance.ravel()},
            **{"regressor": np.zeros(DOF * IDENTIFIED), "measured": np.zeros(DOF), "share": np.ones(1)},
            **{"offsets": calibration.value, "offset_covariance": calibration._fit.covariance.ravel()},
            **{"squares": np.zeros(1), "differences": np.zeros(1), "rates": np.full(2, np.nan)},  # the last two
            **{"standing": np.zeros(1), "last_tick": np.full(1, -2), "last_torque": no_torque()},
            **{"last_x": np.full(2 * DOF, np.nan), "doubts": identification.doubts},
        }
        self._known = {name: np.tile(first, (robots, 1)) for name, first in self._first.items()}
        self._x: Array | None = None

    @property
    def known(self) -> Array:
        """(N, 18), as in `identified_robot.KNOWN`."""
        known = self._known
        return np.concatenate([known["used"], known["offsets"], known["doubts"][:, :1]], axis=1)

    @property
    def disbelief(self) -> Array:
        """(N, 1), see `IdentifiedRobot.disbelief`."""
        doubts = self._known["doubts"]
        return disbelief(doubts) if self._gives_way else np.zeros_like(doubts[:, :1])

    @property
    def lateness(self) -> Array:
        """(N, 1), see `identification.lateness`."""
        return lateness(self._known["used"][:, [LATE_TORQUE]])

    def reset(self, i: int) -> None:
        """Begin an episode of robot `i`."""
        for name, first in self._first.items():
            self._known[name][i] = first

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        self._known = {name: values[rows] for name, values in self._known.items()}

    def set_right(self, q: Array) -> Array:
        """The angles in q (N, 7)."""
        return q - self._known["offsets"] @ OFFSETS.T

    def predicted(self, x: Array, torque: Array) -> Array:
        """The states (N, 14) in which torques (N, 4) that are computed from `x` take effect."""
        self._x = x
        found = self._predict(x, self._rows, torque, self._known["used"][:, [LATE_TORQUE]]).x
        return np.where(np.isfinite(torque.sum(axis=1, keepdims=True)), found, x)

    def estimate(self, tick: Array, x: Array, p: Array, force: Array, torque: Array) -> Estimates:
        """Learn from the tick that ends now; then by how much the robots found differ from the nominal one."""
        measured = x if self._x is None else self._x
        self._learn(tick[:, None], measured, force, torque)
        known = self._known
        used = (
            in_use(known["value"], known["base"], self._start, known["doubts"]) if self._gives_way else known["value"]
        )
        self._known |= {"used": used, "last_tick": tick[:, None], "last_torque": torque, "last_x": measured}
        other, rows = p.copy(), self._rows
        other[:, : rows.shape[1]] = rows
        found = self._model_error(x, p, other)
        return Estimates(found.alpha, found.beta, found.output_error)

    @property
    def _rows(self) -> Array:
        """Their numbers; see `RobotNumbers.with_links`."""
        value = self._known["used"]
        rows, theta = np.tile(self._nominal, (len(value), 1)), value[:, THETA]
        rows[:, PLACES["links"]] = np.concatenate([theta, theta[:, len(INERTIAL) :]], axis=1)
        rows[:, PLACES["motor_gain"]] = value[:, [MOTOR_GAIN]]
        rows[:, PLACES["joint_damping"]] = value[:, [DAMPING]]
        return rows

    def _learn(self, tick: Array, measured: Array, force: Array, torque: Array) -> None:
        known, (stance, swing) = self._known, (force[:, [0], 1], force[:, [1], 1])
        is_pinned = (known["last_tick"] + 1 == tick) & np.isfinite(torque.sum(axis=1, keepdims=True))
        is_pinned &= (swing < CONTACT_FORCE) & (stance >= CONTACT_FORCE)
        for name in ("standing", "regressor", "measured", "share", "rates"):
            known[name] = np.where(is_pinned, known[name], self._first[name])
        known["standing"] = known["standing"] + is_pinned
        learns = is_pinned & (known["standing"] > SETTLING)
        learns &= np.isfinite(known["last_torque"].sum(axis=1, keepdims=True))
        if not learns.any():
            return
        lengths, offsets = (known["joints"], known["feet"]), (known["offsets"], known["offset_covariance"])
        found = self._calibrate(measured, *lengths, *offsets)
        self._take((found.value, found.covariance), learns, "offsets", "offset_covariance")
        self._find_noise(learns, known["last_x"][:, [PITCH_RATE]], measured[:, [PITCH_RATE]])
        learns &= known["differences"] >= FIRST_DIFFERENCES
        if not learns.any():
            return
        variance = RATE_NOISE**2 + CORRELATED * known["squares"] / (PER_VARIANCE * np.fmax(known["differences"], 1))
        of_fit = known["value"][:, THETA], *(known[name] for name in FITS)
        of_tick = known["last_x"], measured, known["last_torque"], torque, force
        filtered = known["regressor"], known["measured"], known["share"]
        found = self._identify(*lengths, *of_fit, *of_tick, *filtered, variance, known["doubts"])
        for name, new in (("regressor", found.regressor), ("measured", found.measured), ("share", np.full(1, SHARE))):
            known[name] = np.where(learns, new.reshape(len(new), -1) if new.ndim > 1 else new, known[name])
        self._take((found.value, found.covariance), learns, "fit", "covariance")
        self._take((found.base, found.base_covariance), learns, "base_fit", "base_covariance")
        known["doubts"] = np.where(learns, found.doubts.reshape(len(learns), -1), known["doubts"])
        for name, fit, is_one in (
            ("value", known["fit"], learns & (known["fit"][:, [MOTOR_GAIN]] > 0)),
            ("base", known["base_fit"], learns),
        ):
            physical = np.array([[is_physical(theta)] for theta in fit[:, THETA]])
            known[name] = np.where(is_one & physical, fit, known[name])

    def _take(self, found: tuple[Array, Array], learns: Array, value: str, covariance: str) -> None:
        """See `LeastSquares.take`."""
        given = found[0], found[1].reshape(len(learns), -1)
        takes = learns & np.isfinite(sum(each.sum(axis=1, keepdims=True) for each in given))
        for name, new in zip((value, covariance), given, strict=True):
            self._known[name] = np.where(takes, new, self._known[name])

    def _find_noise(self, learns: Array, start: Array, end: Array) -> None:
        """See `RateNoise.add`."""
        known, rates = self._known, self._known["rates"]
        has_two = learns & ~np.isnan(rates[:, :1])
        second = rates[:, [0]] - 2 * rates[:, [1]] + end
        squares = np.array([[each**2] for (each,) in second.tolist()])  # as of one: an array's may round otherwise
        known["squares"] = np.where(has_two, known["squares"] + squares, known["squares"])
        known["differences"] = known["differences"] + has_two
        before = np.where(np.isnan(rates[:, :1]), start, rates[:, [1]])
        known["rates"] = np.where(learns, np.concatenate([before, end], axis=1), rates)
