"""Parameters of the simulator's node besides the plant's."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field
from rabbit_description import DEFAULT_GAIT


class NodeParameters(BaseModel):
    """Episodes, pace, and how long is waited for whom."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    IS_SIMULATED: ClassVar[bool] = True  # a robot has drivers of its own for its sensors

    gait: str = Field(
        DEFAULT_GAIT,
        description="gait whose post-impact state the robot starts from: a name or a file, also of a library",
    )
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode; the next ones count up from it")
    episodes: int = Field(1, ge=0, description="episodes to walk by itself; 0: those that reset_episode asks for")
    publish_tf: bool = Field(
        True, description="publish `tf` and `robot_description`; false beside a robot_state_publisher"
    )
    start_paused: bool = Field(False, description="wait for the pause service to let the first episode begin")
    readers: int = Field(1, ge=1, le=100, description="nodes that must hear the state before an episode begins")
    pace: float = Field(0.0, ge=0, le=100, description="times real time at most; 0: no limit in lock-step; dynamic")
    real_time: bool = Field(False, description="a tick lasts 10 ms (over pace) by the wall clock, answered or not")
    held_ticks: int = Field(2, ge=0, le=1000, description="real time: how long the last torque stands in for late ones")
    damped_ticks: int = Field(10, ge=0, le=1000, description="real time: of joint damping after these, then it ends")
    damping: float = Field(10.0, ge=0, le=30, description="real time: of each joint in these ticks, N m s/rad")
    late_limit: float = Field(0.001, ge=0, le=1, description="real time: share of late ticks above which it warns")
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")
    answer_timeout: float = Field(5.0, gt=0, le=3600, description="s without a torque that end an episode")
    trainer_timeout: float = Field(600.0, gt=0, le=86400, description="s that the trainer may take between episodes")
    memory: str = Field(
        "", description="file that keeps episode and clock for a simulator started again; empty: it counts from 1"
    )
    trainer: Literal["ignore", "wait", "follow"] = Field(
        "ignore", description="wait: until it has digested the last episode; follow: and as it plans the next one"
    )
