"""What the state estimator assumes of its sensors and of the robot's motion."""

from math import pi
from typing import Annotated

from pydantic import BaseModel, Field
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import ABOUT_TICK, TickSeconds
from rabbit_description.validation import Checked

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class NodeParameters(Checked):
    """Parameters of the estimator's node besides the estimator's."""

    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")


class EstimatorParameters(Checked):
    """Flat, immutable and checked. Standard deviations, unless said otherwise."""

    tick_seconds: TickSeconds = Field(TICK_SECONDS, description=ABOUT_TICK)
    encoder_resolution: Positive = Field(2 * pi / 2**14, description="step of the joint angles, rad")
    rate_window: Positive = Field(0.002, description="time over which an encoder's drive takes the rate, s")
    encoder_offset: Positive = Field(1e-3, description="std of a joint angle's constant error, rad")
    bend: float = Field(
        0.03, ge=0, le=0.3, description="std of both legs' bend: foot forward of the hip over the leg's length"
    )
    sensor_delay: float = Field(0.0, ge=0, le=0.1, description="age of what encoders and IMU say, s")
    gyro_noise: Positive = Field(0.005, description="std of the gyro's noise, rad/s")
    gyro_bias: Positive = Field(0.005, description="std of the gyro's constant error, rad/s")
    accelerometer_noise: Positive = Field(0.1, description="std of the accelerometer's noise, m/s^2")
    accelerometer_bias: Positive = Field(0.05, description="std of the accelerometer's constant error, m/s^2")
    attitude_error: Positive = Field(0.003, description="std of the IMU's first attitude, rad")

    jerk: Positive = Field(10.0, description="std of the joints' white jerk, rad/s^2 over a root of a second")
    first_acceleration: Positive = Field(100.0, description="std of the joints' accelerations at the start, rad/s^2")
    first_speed: Positive = Field(0.01, description="std of the stance foot's speed at the start, m/s")
    shock_rate: Positive = Field(4.0, description="a stance leg's joint rate over the hip's speed, in a shock, rad/m")
    shock_acceleration: Positive = Field(
        8.0, description="a stance leg's joint acceleration over the hip's, in a shock, rad/m"
    )
    swing_shock: Positive = Field(3.0, description="factor on shock_rate and shock_acceleration in the swing leg")
    shock_measured: Positive = Field(
        0.7, description="error of a measured rate over the hip's speed, in a shock, rad/m"
    )
    shock_foot: Positive = Field(0.4, description="speed of the stance foot over the hip's, in a shock")
    shock_speed: Positive = Field(0.02, description="error of the hip's speed, integrated, over its change in a shock")
    foot_radius: float = Field(0.002, ge=0, le=0.1, description="radius of the round feet, m")
    foot_slide: Positive = Field(1e-4, description="std of where the stance foot is seen to stand, m")
    foot_roll: Positive = Field(5e-6, description="std of the stance foot's movement in 10 ms, m")
    foot_speed: Positive = Field(0.001, description="std of the stance foot's speed, m/s")
    landing_speed: Positive = Field(0.15, description="std of a foot's speed in the tick in which it lands, m/s")
    settling: float = Field(0.2, ge=0, lt=1, description="share of landing_speed that is left 10 ms later")
    landing_shift: Positive = Field(5e-4, description="std of where a foot comes to rest, m")
    compliance: float = Field(1e-6, ge=0, description="mean of how far a foot and its ground sink for a force, m/N")
    compliance_error: Positive = Field(1e-5, description="std of the compliance, m/N")
    sinking_time: Positive = Field(0.03, description="damping of foot and ground over their stiffness, s")
    least_step: float = Field(0.1, ge=0, description="time after a touchdown in which there is no other, s")

    @classmethod
    def knowing(cls, sensors: BaseModel) -> "EstimatorParameters":
        """The parameters, with a simulation's errors of the sensors: those of the same name, but for zeros."""
        errors = {name: getattr(sensors, name, 0.0) for name in cls.model_fields}
        return cls(**{name: value for name, value in errors.items() if value > 0})
