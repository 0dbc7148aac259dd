"""What the state estimator believes of its sensors and of the robot's motion."""

from math import pi, sqrt
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class EstimatorParameters(BaseModel):
    """Flat, immutable and checked. Standard deviations, unless said otherwise."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    encoder_resolution: Positive = Field(2 * pi / 2**14, description="step of the joint angles, rad")
    rate_window: Positive = Field(0.002, description="over which an encoder's drive takes the rate, s")
    encoder_offset: Positive = Field(1e-3, description="of a joint's constant error, rad")
    bend: float = Field(0.03, ge=0, le=0.3, description="of both legs: foot forward of the hip over the leg's length")
    gyro_noise: Positive = Field(0.005, description="of the gyro, rad/s")
    gyro_bias: Positive = Field(0.005, description="of its constant error, rad/s")
    accelerometer_noise: Positive = Field(0.1, description="of the accelerometer, m/s^2")
    accelerometer_bias: Positive = Field(0.05, description="of its constant error, m/s^2")
    attitude_error: Positive = Field(0.003, description="of the IMU's first attitude, rad")

    jerk: Positive = Field(200.0, description="of the joints: white, rad/s^2 over a root of a second")
    first_acceleration: Positive = Field(100.0, description="of the joints after an impact, rad/s^2")
    impact_rate: Positive = Field(3.0, description="change of a joint's rate at an impact, rad/s")
    settling: int = Field(2, ge=0, description="ticks after an impact in which it goes on")
    settling_rate: Positive = Field(1.0, description="change of a joint's rate in such a tick, rad/s")
    impact_speed: Positive = Field(0.01, description="of the hip's change of speed by an impact, m/s")
    impact_shift: Positive = Field(0.002, description="of the hip in a tick with an impact, m")
    impulse_speed: Positive = Field(0.002, description="of the hip's change of speed in a tick, m/s")
    foot_radius: float = Field(0.002, ge=0, le=0.1, description="of the round feet, m")
    foot_slide: Positive = Field(4e-4, description="of where the stance foot is seen to stand, m")
    foot_roll: Positive = Field(5e-5, description="by which it moves in a tick, m")
    foot_speed: Positive = Field(0.015, description="of the stance foot, m/s")
    landing_speed: Positive = Field(0.5, description="of a foot in the tick in which it lands, m/s")
    landing_rate: Positive = Field(0.5, description="of a joint's rate in that tick, rad/s")
    landing_shift: Positive = Field(5e-4, description="of where a foot comes to rest, m")
    least_step: float = Field(0.1, ge=0, description="after a touchdown, in which there is no other, s")

    @classmethod
    def knowing(cls, sensors: BaseModel) -> "EstimatorParameters":
        """With the errors that a simulation's parameters give the sensors: those of the same name, but for zeros."""
        errors = {name: getattr(sensors, name, 0.0) for name in cls.model_fields}
        return cls(**{name: value for name, value in errors.items() if value > 0})

    @property
    def angle_noise(self) -> float:
        """Of an encoder's rounding, rad."""
        return self.encoder_resolution / sqrt(12)

    @property
    def rate_noise(self) -> float:
        """Of the rate between two rounded angles, rad/s."""
        return sqrt(2) * self.angle_noise / self.rate_window
