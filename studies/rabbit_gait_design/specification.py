"""What a gait must be: step, speed, stones and limits. The defaults are those of `DEFAULT_GAIT`."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, model_validator
from rabbit_description.validation import Checked

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Stone:
    """A stone and the barriers' shape: edges and radii in m, poles in 1/s."""

    l_min: float
    l_max: float
    R1: float
    R2: float
    poles: tuple[float, float]


class GaitSpecification(Checked):
    """Parameters of one trajectory optimisation; lengths in m, angles in rad, forces in N, torques in N m.

    The stone is [step_length - near_edge, step_length + far_edge] ahead of the stance foot; both barriers' inequalities
    hold along the whole gait for every stone whose edges lie that far off. Up to phase `clear_until` the foot is high
    enough for the farthest stone too: otherwise B2 of a far stone meets the foot before the circle's middle and pushes
    it back. A smaller R2 than the controller's makes the circle higher: room to spare. On a
    slope, lengths are along the ground and angles from its normal.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", description="file name without .yaml")
    step_length: float = Field(0.35, ge=0.1, le=0.7, description="step length, m")
    speed: float = Field(0.8, ge=0.2, le=1.5, description="mean walking speed, m/s")
    slope: float = Field(0.0, ge=-15, le=15, description="rise of the ground, degrees")

    near_edge: float = Field(0.02, ge=-0.1, le=0.2, description="near edge of the stone before the landing point, m")
    far_edge: float = Field(0.05, ge=0.0, le=0.2, description="far edge of the stone beyond the landing point, m")
    barriers: bool = Field(True, description="hold both barrier inequalities along the gait")
    R1: float = Field(1.0, gt=0, le=50, description="radius offset of the outer circle (B1), m")
    R2: float = Field(0.36, gt=0, le=50, description="depth of the inner circle's centre (B2), m")
    barrier_poles: tuple[Positive, Positive] = Field((70.0, 70.0), description="poles of both barriers, 1/s")
    farthest_l_min: float = Field(0.403, ge=0.1, le=0.7, description="near edge of the farthest stone to be met, m")
    clear_until: float = Field(0.0, ge=0, le=1, description="phase until which that stone's B2 must not push back")
    barrier_margin: float = Field(0.0, ge=0, le=50, description="least B'' + (p1+p2) B' + p1 p2 B, m/s^2")

    friction_limit: float = Field(0.5, gt=0, le=1.5, description="largest abs(F_T) / F_N")
    min_normal_force: float = Field(120.0, ge=0, le=300, description="least normal force F_N, N")
    torque_limit: float = Field(120.0, gt=0, le=200, description="largest joint torque, N m")
    max_foot_height: float = Field(0.12, gt=0, le=0.3, description="largest height of the swing foot, m")
    clearance: float = Field(0.02, ge=0, le=0.1, description="least height of the swing foot in mid-swing, m")
    lift_speed: float = Field(0.1, ge=0, le=1, description="least upward speed of the swing foot after impact, m/s")
    landing_speed: float = Field(0.15, ge=0, le=2, description="least downward speed of the swing foot at impact, m/s")
    max_landing_speed: float = Field(0.6, gt=0, le=3, description="largest downward speed at impact, m/s")
    max_landing_slide: float = Field(0.6, gt=0, le=3, description="largest horizontal foot speed at impact, m/s")
    knee_range: tuple[float, float] = Field((0.1, 1.6), description="knee angles, rad")
    pitch_range: tuple[float, float] = Field((-0.3, 0.5), description="torso pitch, rad")

    intervals: int = Field(20, ge=6, le=100, description="Hermite-Simpson intervals over the phase")
    max_iterations: int = Field(500, ge=10, le=5000, description="IPOPT's iteration limit")

    @model_validator(mode="after")
    def _ranges_are_ordered(self) -> "GaitSpecification":
        for name in ("knee_range", "pitch_range"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = ({low}, {high}): expected low < high")
        if self.landing_speed > self.max_landing_speed:
            raise ValueError(
                f"landing_speed = {self.landing_speed} exceeds max_landing_speed = {self.max_landing_speed}"
            )
        if self.near_edge >= self.step_length:
            raise ValueError(f"near_edge = {self.near_edge}: expected less than step_length = {self.step_length}")
        return self

    @property
    def step_time(self) -> float:
        """Step time, s."""
        return self.step_length / self.speed

    @property
    def stone(self) -> Stone:
        """The one whose barriers the gait keeps, if it has `barriers`."""
        near, far = self.step_length - self.near_edge, self.step_length + self.far_edge
        return Stone(near, far, self.R1, self.R2, self.barrier_poles)
