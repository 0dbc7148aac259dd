"""Everything about the true plant, its course and its start that can be set."""

import math
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from rabbit_description.plugins import names
from rabbit_description.state import TORQUE_LIMIT

SUBSTEP_SECONDS = 0.001
FARTHEST_EDGE = 0.9  # m from the stance foot, of any stone
# A foot's rubber. A rigid contact has two answers where friction carries the leg (Painleve): an engine's iteration
# starts at no force and may stay there, so a standing foot lets go. Compliance leaves the one that presses.
RUBBER_STIFFNESS = 1e6  # N/m
RUBBER_DAMPING = 3e4  # N s/m; impacts are inelastic: with less the rubber throws the foot back
HIGHEST_TOP = 0.2  # m above or below the first platform, of any stone
GROUND_OF_ENGINES = ("ground_stiffness", "ground_damping", "stone_height", "loose_stone")
BODY_OF_ENGINES = ("push", "coulomb", "knee_spring", "backlash", "gear_stiffness", "swing_payload")
NEEDS_ENGINE = GROUND_OF_ENGINES + BODY_OF_ENGINES  # `rigid` has none of them

PLANTS = "rabbit.plants"  # entry points; see rabbit_description.plugins
if TYPE_CHECKING:
    PlantName = str
else:
    PlantName = Literal[*names(PLANTS)]
NEARLY_ZERO = 1e-300  # smaller numbers are zero: a product with one leaves the range in which MuJoCo reads
LEAST_PENDULUM = 1e-6  # kg; MuJoCo takes no moving body whose inertia is below 1e-15 kg m^2
Number = Annotated[
    float, Field(allow_inf_nan=False), AfterValidator(lambda value: value if abs(value) >= NEARLY_ZERO else 0.0)
]


class SimulationParameters(BaseModel):
    """Flat, immutable and checked: pydantic's error names the field, its value and what was expected."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    plant: PlantName = Field("pybullet", description="physics engine, or rigid: the paper's hybrid model")

    mass_scale: Number = Field(1.0, ge=0.1, le=10, description="factor on every true mass and inertia")
    payload: Number = Field(0.0, ge=0, le=200, description="point mass on the torso, kg")
    payload_height: Number = Field(0.24, ge=-0.5, le=1, description="of the payload above the hip, m")
    payload_ahead: Number = Field(0.0, ge=-0.5, le=0.5, description="of the payload ahead of the hip, m")
    swing_payload: Number = Field(0.0, ge=0, le=100, description="pendulum that hangs at payload_height, kg")
    swing_length: Number = Field(0.3, ge=0.05, le=2, description="of the pendulum, m")
    left_leg_scale: Number = Field(1.0, ge=0.5, le=2, description="factor on the left leg's masses and inertias")
    motor_lag: Number = Field(0.0, ge=0, le=0.1, description="first-order time constant of the motors, s")
    motor_loss: Number = Field(0.0, ge=0, lt=1, description="fraction of the torque that is lost")
    left_hip_gain: Number = Field(1.0, ge=0.1, le=2, description="share of the torque that this motor gives")
    left_knee_gain: Number = Field(1.0, ge=0.1, le=2, description="share of the torque that this motor gives")
    right_hip_gain: Number = Field(1.0, ge=0.1, le=2, description="share of the torque that this motor gives")
    right_knee_gain: Number = Field(1.0, ge=0.1, le=2, description="share of the torque that this motor gives")
    torque_rate: Number = Field(0.0, ge=0, le=1e6, description="most that the torque changes, N m/s; 0: no limit")
    coulomb: Number = Field(0.0, ge=0, le=100, description="dry friction of each joint, with stiction, N m")
    knee_spring: Number = Field(0.0, ge=0, le=1000, description="beside the knees' motors, N m/rad")
    knee_rest: Number = Field(0.4, ge=-1, le=2, description="where the knees' springs are at rest, rad")
    backlash: Number = Field(0.0, ge=0, le=5, description="play of each joint's gear from side to side, degrees")
    gear_stiffness: Number = Field(0.0, ge=0, le=2e4, description="of elastic joints, N m/rad; 0: rigid")
    joint_damping: Number = Field(0.0, ge=0, le=100, description="d in the joint torque -d M_jj dq_j, 1/s")
    link_bend: Number = Field(0.0, ge=-0.3, le=0.3, description="forward shift of knee and foot over link length")
    ground_friction: Number = Field(1.5, ge=1e-6, le=5, description="Coulomb coefficient of the true ground")
    ground_stiffness: Number = Field(
        RUBBER_STIFFNESS, ge=1e4, le=RUBBER_STIFFNESS, description="of ground and foot together, N/m"
    )
    ground_damping: Number = Field(
        RUBBER_DAMPING, ge=0, le=RUBBER_DAMPING, description="of ground and foot together, N s/m"
    )
    push: Number = Field(0.0, ge=0, le=100, description="on the torso in 100 ms, forward and backward in turn, N s")
    push_interval: Number = Field(1.5, ge=0.1, le=60, description="from the beginning of a push to the next, s")
    slope: Number = Field(0.0, ge=-20, le=20, description="rise of the ground, unknown to the controller, degrees")

    encoder_resolution: Number = Field(0.0, ge=0, le=0.1, description="step of the measured angles, rad")
    velocity_noise: Number = Field(0.0, ge=0, le=10, description="std of the measured angle rates, rad/s")
    force_noise: Number = Field(0.0, ge=0, le=1000, description="std of the measured foot forces, N")
    sensors: Literal["exact", "lab"] = Field(
        "exact", description="the whole state, or encoders and IMU alone: a state estimator's work"
    )
    encoder_offset: Number = Field(0.001, ge=0, le=0.1, description="std of a joint's constant error, rad (lab)")
    gyro_noise: Number = Field(0.005, ge=0, le=1, description="std of the gyro, rad/s (lab)")
    gyro_bias: Number = Field(0.005, ge=0, le=1, description="std of its constant error, rad/s (lab)")
    accelerometer_noise: Number = Field(0.1, ge=0, le=10, description="std of the accelerometer, m/s^2 (lab)")
    accelerometer_bias: Number = Field(0.05, ge=0, le=10, description="std of its constant error, m/s^2 (lab)")
    attitude_error: Number = Field(0.003, ge=0, le=0.1, description="std of the IMU's first attitude, rad (lab)")
    sensor_delay: Number = Field(0.0, ge=0, le=0.01, description="age of their readings, whole ms, s (lab)")
    torque_delay: Number = Field(0.0, ge=0, le=0.1, description="dead time of the motors, whole ms, s")
    torque_limit: Number = Field(TORQUE_LIMIT, ge=1e-6, le=10000, description="saturation of each motor, N m")

    terrain: Literal["flat", "stones"] = Field("stones", description="flat ground or stones with gaps")
    stones: int = Field(20, ge=1, le=4000, description="stones of an episode; on flat ground, steps")
    l_min_mean: Number = Field(0.35, ge=1e-6, le=0.8, description="mean of the near edge, m from the stance foot")
    l_min_std: Number = Field(0.02, ge=0, le=0.3, description="standard deviation of the near edge, m")
    l_min_truncation: Number = Field(2.5, ge=1e-6, le=6, description="largest deviation from the mean, in std")
    l_min_distribution: Literal["normal", "uniform"] = Field(
        "normal", description="of the near edge, both on mean +- truncation x std"
    )
    stone_width: Number = Field(0.05, ge=1e-3, le=0.5, description="l_max - l_min, m")
    stone_placement: Literal["relative", "absolute"] = Field(
        "relative", description="from where the foot landed, or from the middle of the stone before"
    )
    stone_height: Number = Field(
        0.0, ge=0, le=HIGHEST_TOP, description="largest deviation of a stone's top from the first platform's, m"
    )
    loose_stone: int = Field(0, ge=0, le=4000, description="stone that gives way under the first foot on it; 0: none")
    loose_depth: Number = Field(0.02, ge=0.001, le=HIGHEST_TOP, description="by which the top of that stone drops, m")
    height_preview: bool = Field(True, description="the preview of a stone tells its height")
    course: str = Field("", description="file of stones (.yaml or .csv); empty: drawn")

    x0_position_std: Number = Field(0.02, ge=0, le=0.5, description="noise of the first angles, rad")
    x0_velocity_std: Number = Field(0.05, ge=0, le=1, description="noise of the first angle rates, over their size")
    x0_spread: Number = Field(1.0, ge=0, le=10, description="factor on both")

    stop_at_miss: bool = Field(True, description="a missed stone ends the episode")
    fall_height: Number = Field(0.70, ge=0, le=0.8, description="a hip below it has fallen, m")
    fall_pitch: Number = Field(math.pi / 3, ge=1e-6, le=math.pi, description="a torso beyond it has fallen, rad")

    @model_validator(mode="after")
    def _edges_are_in_reach(self) -> "SimulationParameters":
        nearest = self.l_min_mean - self.l_min_truncation * self.l_min_std
        if nearest <= 0:
            raise ValueError(f"l_min_mean - l_min_truncation * l_min_std = {nearest:g}: expected more than 0 m")
        farthest = self.l_min_mean + self.l_min_truncation * self.l_min_std + self.stone_width
        if not self.course and farthest > FARTHEST_EDGE:
            names = "l_min_mean + l_min_truncation * l_min_std + stone_width"
            raise ValueError(f"{names} = {farthest:g}: expected at most {FARTHEST_EDGE} m")
        return self

    @model_validator(mode="after")
    def _pendulum_has_mass(self) -> "SimulationParameters":
        if 0 < self.swing_payload < LEAST_PENDULUM:
            raise ValueError(f"swing_payload = {self.swing_payload:g}: expected 0 or at least {LEAST_PENDULUM:g} kg")
        return self

    @model_validator(mode="after")
    def _plant_can(self) -> "SimulationParameters":
        for name in NEEDS_ENGINE if self.plant == "rigid" else ():
            if (value := getattr(self, name)) != (default := type(self).model_fields[name].default):
                raise ValueError(f"{name} = {value:g} with plant rigid: expected {default:g}, pybullet or mujoco")
        return self

    @model_validator(mode="after")
    def _delays_are_whole_substeps(self) -> "SimulationParameters":
        for name in ("torque_delay", "sensor_delay"):
            steps = getattr(self, name) / SUBSTEP_SECONDS
            if abs(steps - round(steps)) > 1e-6:
                raise ValueError(f"{name} = {getattr(self, name):g}: expected a multiple of {SUBSTEP_SECONDS:g} s")
        return self
