"""The controller's parameters: typed, bounded, described. One model serves files, the command line and ROS."""

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError, model_validator
from rabbit_description import DEFAULT_GAIT
from rabbit_description.bounded_file import FileError
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import ABOUT_TICK, TickSeconds
from rabbit_description.validation import Checked, one_line, one_of

from rl_cbf_clf_controller.kinds import ControllerName, find_kind
from rl_cbf_clf_controller.problem import Problem

CONFIG = Path(__file__).parent / "config"
ON_FLAT_GROUND = "on_flat_ground"
EPS_LEAST = 1e-4


class ParameterError(ValueError):
    """A parameter file that cannot be used: names the file, the parameter, its value and what was expected."""


class ControllerParameters(Checked):
    """Everything that shapes the controller. Defaults are this project's; `authors.yaml` has the first author's."""

    controller: ControllerName = Field("cbf-clf-qp", description="name of the controller")
    gait: str = Field(DEFAULT_GAIT, description="name of a shipped gait or library, or a file's path")
    stone_aim: float = Field(
        0.5, ge=0, le=1, description="where a gait library aims: share of the stone's width beyond its near edge"
    )
    tick_seconds: TickSeconds = Field(TICK_SECONDS, description=ABOUT_TICK)
    eps: float = Field(0.04, ge=EPS_LEAST, le=1, description="epsilon of the RES-CLF")
    doubt_eps: float = Field(
        0.0,
        ge=0,
        le=1,
        description="eps as far as the identified robot does not explain what is measured: there the nominal model"
        " counts instead; 0: the identified robot always counts",
    )
    kp: float = Field(0.5, ge=1e-4, le=100, description="gain on y at eps = 1")
    kd: float = Field(0.8660254037844386, ge=1e-4, le=100, description="gain on dy at eps = 1")
    clf_row: Literal["normalised", "literal"] = Field(
        "normalised", description="whether the CLF row is divided by its norm, so that d is in units of mu"
    )
    objective: Literal["paper", "pd_centred"] = Field(
        "paper",
        description="what the QP minimises: mu'mu, or the distance of the estimated output dynamics from a PD law",
    )
    adaptation: Literal["none", "identification"] = Field(
        "none", description="whether the true robot is identified as it walks"
    )
    prediction: bool = Field(
        False, description="whether the QP is solved for the state in which its torque takes effect, as identified"
    )
    speed_regulation: Literal["learned", "integral"] = Field(
        "learned", description="how a library with slopes keeps its speed: by a learned model, or by PI control"
    )
    torque_change_weight: float = Field(
        0.0,
        ge=0,
        le=100,
        description="weight in pd_centred of the torque's change since the last tick; beside an identification, only as"
        " far as torque is found to arrive late",
    )
    slack_weight: float = Field(10.0, ge=1e-6, le=1e6, description="p, weight of the CLF slack d")
    barrier_pole_1: float = Field(70.0, ge=1e-6, le=1000, description="first ECBF pole, 1/s")
    barrier_pole_2: float = Field(70.0, ge=1e-6, le=1000, description="second ECBF pole, 1/s")
    R1: float = Field(1.0, ge=1e-6, le=100, description="radius offset of the outer circle, m")
    R2: float = Field(0.5, ge=1e-6, le=100, description="depth of the inner circle's centre, m")
    stone_margin: float = Field(
        0.005,
        ge=0,
        le=0.02,
        description="distance kept from both edges of a stone, for what happens between two ticks, m",
    )
    late_margin: float = Field(
        0.0, ge=0, le=0.02, description="more stone_margin beside an identification, as far as torque is found late, m"
    )
    stone_tracking: bool = Field(
        False, description="whether the next stone stays where it was seen while the stance foot falls with its own"
    )
    barrier_rows: bool = Field(True, description="stepping-stone barriers in the CBF controllers")
    force_rows: bool = Field(True, description="contact-force rows in the CBF controllers")
    flat_force_rows: bool = Field(False, description="contact-force rows in the flat-ground controllers as well")
    cone: Literal["two_rows", "literal"] = Field("two_rows", description="form of the friction cone rows")
    friction_coeff: float = Field(0.8, ge=1e-6, le=10, description="k_f, the limit of |F_T| / F_N")
    friction_margin: float = Field(
        0.2,
        ge=0,
        le=1,
        description="part of k_f that is kept back, for what held torques and motor lag add between two ticks",
    )
    min_normal_force: float = Field(20.0, ge=0, le=1000, description="least normal force of row C1, N")
    torque_limit: float = Field(200.0, ge=1e-6, le=10000, description="limit of each motor's torque, N m")
    sigma: float = Field(0.0, ge=0, le=1000, description="standard deviation of the exploration noise on mu, rad/s^2")
    qp_solver: Literal["osqp", "daqp"] = Field("osqp", description="QP solver; the other one is its guard")
    swap_time: float = Field(0.15, ge=0, le=5, description="least time of a step before the legs swap, s")
    swap_phase: float = Field(0.5, ge=0, le=1, description="least phase before the legs swap")
    l1_law: Literal["piecewise", "exact", "euler"] = Field("piecewise", description="adaptation law of L1")
    l1_gain: float = Field(1.0, ge=1e-6, le=1e9, description="adaptation gain of L1; the piecewise law has none")
    l1_cutoff: float = Field(100.0, ge=1e-6, le=1e4, description="cut-off of L1's low-pass filter, 1/s")
    l1_substeps: int = Field(1, ge=1, le=100, description="steps of L1's adaptation in a tick")
    l1_slope_bound: float = Field(1.0, ge=1e-6, le=1e6, description="bound of L1's estimate in proportion to |mu|")
    l1_offset_bound: float = Field(500.0, ge=1e-6, le=1e6, description="bound of the rest of L1's estimate, rad/s^2")
    robust_scale_min: float = Field(1.0, ge=0.1, le=10, description="least mass scale that the robust rows allow for")
    robust_scale_max: float = Field(
        2.0, ge=1e-6, le=10, description="largest mass scale that the robust rows allow for"
    )

    @model_validator(mode="after")
    def _fit_together(self) -> "ControllerParameters":
        margin, coeff = self.friction_margin, self.friction_coeff
        low, high, adaptation = self.robust_scale_min, self.robust_scale_max, self.adaptation
        if margin >= coeff:
            raise ValueError(f"friction_margin = {margin}: expected less than friction_coeff = {coeff}")
        if low > high:
            raise ValueError(f"robust_scale_min = {low}: expected at most robust_scale_max = {high}")
        if adaptation != "none" and self.problem.corrects_input:
            raise ValueError(f"adaptation = {adaptation}: expected none, {self.controller} estimates no rows")
        if self.prediction and adaptation != "identification":
            raise ValueError(f"prediction = True: expected adaptation = identification, not {adaptation}")
        if self.doubt_eps and adaptation != "identification":
            raise ValueError(f"doubt_eps = {self.doubt_eps}: expected adaptation = identification, not {adaptation}")
        if 0 < self.doubt_eps < EPS_LEAST:
            raise ValueError(f"doubt_eps = {self.doubt_eps}: expected 0 or at least {EPS_LEAST}")
        return self

    @property
    def problem(self) -> Problem:
        """The learning problem whose quantities this controller's estimates are."""
        return find_kind(self.controller).problem

    @property
    def terrain(self) -> Literal["flat", "stones"]:
        """What the controller walks on: with barriers on the stone in sight, or on flat ground."""
        return find_kind(self.controller).terrain

    @property
    def learns(self) -> bool:
        """Whether a policy belongs to the controller."""
        return find_kind(self.controller).learns


def load_parameters(name_or_path: str | Path, terrain: str | None = None, /, **changes: object) -> ControllerParameters:
    """Read `ours`, `best`, `nominal_tuned`, `authors` or a YAML file, then apply `changes`.

    The file may have a section ON_FLAT_GROUND: values in place of its others where `terrain` is "flat".

    Raises:
        ParameterError: no such file, not YAML, an unknown parameter or a value out of its range.
    """
    from rabbit_description.yaml_file import read_mapping, shortened  # not for --help

    path, shipped = Path(name_or_path), sorted(path.stem for path in CONFIG.glob("*.yaml"))
    path = path if path.suffix else CONFIG / f"{name_or_path}.yaml"
    if path.parent == CONFIG and path.stem not in shipped:
        raise ParameterError(f"parameters {name_or_path}: expected {one_of(name_or_path, shipped)}, or a YAML file")
    try:
        values = read_mapping(path)
        on_flat_ground = values.pop(ON_FLAT_GROUND, {})
        if not isinstance(on_flat_ground, dict):
            raise FileError(f"{ON_FLAT_GROUND} = {shortened(on_flat_ground)}: expected names, each with a value")
        usual = ControllerParameters.model_validate({**values, **changes})
        flat = ControllerParameters.model_validate({**values, **on_flat_ground, **changes})
        return flat if terrain == "flat" else usual
    except (FileError, ValidationError) as error:
        raise ParameterError(f"controller parameters {path}: {one_line(error)}") from error
