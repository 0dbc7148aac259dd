"""What keeps a robot whole: its commands, its sensors' times, the guard of its motors; and what its drives offer."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from rabbit_bringup.command_guard import CommandGuard, GuardParameters
from rabbit_bringup.hardware import Hardware, HardwareParameters
from rabbit_bringup.sensor_watch import EncoderWatch, SensorClock
from rabbit_description import robot_description
from rabbit_description.state import ACTUATED, BodySensors, Leg, orientation_of

TICK = 10_000_000  # ns
FULL = np.array([200.0, -200.0, 50.0, 0.0])


def sensors(angles=(-0.3, 0.4, 0.2, 0.7), rates=(0.0,) * 4, pitch_rate=0.0):
    return BodySensors(np.array(angles), np.array(rates), orientation_of(0.1), pitch_rate, np.array([0.0, 9.81]))


def make(**changes):
    sent = []
    robot = Hardware(HardwareParameters(**changes), sent.append)
    robot.sensors, robot.at = sensors(), 5.0
    robot.reset(np.zeros(7), np.zeros(7), Leg.LEFT)
    robot.observe()
    return robot, sent


def later(robot, seconds=0.01, **changes):
    """A tick passes."""
    robot.at += seconds
    robot.sensors = sensors(**changes)
    robot.observe()


def test_torques_grow_from_nothing_over_the_ramp():
    robot, sent = make(ramp=0.3, command_rate=1e6)
    for _ in range(40):
        robot.command(FULL)
        later(robot)
    share = np.minimum(np.arange(1, 41) / 30, 1.0)
    np.testing.assert_allclose(sent, share[:, None] * FULL, atol=1e-9)


def test_the_rate_is_per_second_of_the_sensors_and_not_per_command():
    robot, sent = make(ramp=1e-9, command_rate=1e3)
    robot.command(FULL)
    for _ in range(3):
        later(robot)
        for _ in range(5):
            robot.command(FULL)
    assert np.array(sent)[:, 0].tolist() == pytest.approx([10.0] + 5 * [20.0] + 5 * [30.0] + 5 * [40.0])
    robot.stop()
    assert sent[-1].tolist() == [0.0] * 4


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"angles": (-0.3, 2.6, 0.2, 0.7)}, "joint limits: left_knee 2.6 rad; expected -2.5 to 2.5"),
        ({"rates": (0.0, 0.0, -21.0, 0.0)}, "joint rate: right_hip -21 rad/s; expected at most 20"),
    ],
)
def test_a_joint_beyond_its_limits_is_named(changes, fault):
    robot, _ = make()
    assert robot.fault == ""
    later(robot, **changes)
    assert robot.fault == fault


def test_a_joint_may_not_stay_at_its_largest_torque():
    robot, _ = make(ramp=1e-9, limit_time=0.2, command_rate=1e6)
    ticks = 0
    while not robot.fault:
        later(robot, angles=np.array([-0.3, 0.4, 0.2, 0.7]) + 1e-3 * ticks)
        robot.command(FULL)
        ticks += 1
    assert ticks == 1 + 21  # the first command is at the limit; 20 ticks are 0.2 s
    assert robot.fault == "torque limit: left_hip 0.21, left_knee 0.21 s; expected at most 0.2"


def test_a_pose_is_judged_by_joint_and_named():
    robot, _ = make(start_tolerance=0.15)
    start = np.array([0.0, 0.8, 0.1, -0.3, 0.4, 0.2, 0.7])
    assert robot.far_from(start) == ""
    assert robot.far_from(start + 0.14) == ""
    start[2], start[4] = 0.3, -0.5
    expected = "not near the gait's start: torso 0.10 (expected 0.30), left_knee 0.40 (expected -0.50), +-0.15 rad"
    assert robot.far_from(start) == expected


def test_encoders_that_say_the_same_while_the_robot_turns_are_frozen():
    moving, rates = np.array([-0.3, 0.4, 0.2, 0.7]), np.array([1.0, 2.0, -1.0, 3.0])
    watch = EncoderWatch(0.045)
    for tick in range(36):
        angles = moving + rates * tick * 0.01
        if tick > 30:  # the left knee says what it said
            angles[1] = moving[1] + rates[1] * 0.3
        watch.see(sensors(angles, rates), 0.01)
        assert watch.are_frozen.tolist() == [False, tick == 35, False, False]
    still = EncoderWatch(0.045)
    for _ in range(100):
        still.see(sensors(), 0.01)
    assert not still.are_frozen.any()
    for _ in range(200):  # all are frozen, and only the gyro says that the robot falls
        still.see(sensors(pitch_rate=1.5), 0.01)
    assert still.are_frozen.all()


def clock():
    made = SensorClock(("joints", "imu"), largest_tick=0.015, largest_skew=0.012)
    for name in ("joints", "imu"):
        made.take(name, 100 * TICK)
    assert (made.ticked, made.fault) == (100 * TICK, "")
    return made


def test_a_tick_is_complete_when_all_sensors_are_10_ms_later():
    made = clock()
    taken = [made.take("joints", 100 * TICK + k * TICK // 4) for k in range(1, 5)]
    assert taken == [False] * 4
    assert made.take("imu", 101 * TICK)
    assert (made.ticked, made.fault) == (101 * TICK, "")


@pytest.mark.parametrize(
    ("stamps", "fault"),
    [
        ({"joints": 102, "imu": 102}, "tick too long: 0.020 s by the stamps; expected at most 0.015"),
        ({"imu": 601, "joints": 101}, "skew: imu is 5.000 s ahead of joints; expected at most 0.012"),
        ({"imu": 40}, "clock went back: imu from 1.000 to 0.400 s"),
        ({"joints": 10_000, "imu": 10_000}, "tick too long: 99.000 s by the stamps; expected at most 0.015"),
    ],
)
def test_times_that_make_no_tick_have_a_name_each(stamps, fault):
    made = clock()
    assert [made.take(name, stamp * TICK) for name, stamp in stamps.items()][-1]
    assert made.fault == fault


def test_a_clock_that_went_back_counts_on_from_there():
    made = clock()
    made.take("imu", TICK)
    assert not made.take("imu", 2 * TICK)  # the other one still says the old time
    made.take("joints", 3 * TICK)
    made.take("imu", 4 * TICK)
    made.take("joints", 4 * TICK)
    assert (made.ticked, made.fault) == (4 * TICK, "")


def guard(**changes):
    """One that has heard a command of zero, and joint_states, at 0 s."""
    made = CommandGuard(GuardParameters(**changes))
    made.sense(100 * TICK, 0.0)
    made.command(FULL, 100 * TICK, 0.0)
    assert not made.acts.any()  # no zero has come yet
    made.command(np.zeros(4), 100 * TICK, 0.0)
    made.command(FULL, 100 * TICK, 0.0)
    assert made.acts.tolist() == FULL.tolist()
    return made


def test_of_two_masters_none_is_obeyed_until_one_commands_zero():
    made = guard()
    assert made.alone(1)
    assert made.acts.any()
    assert not made.alone(2)
    assert not made.acts.any()
    assert made.alone(1)
    made.command(FULL, 100 * TICK, 0.0)
    assert not made.acts.any()
    made.command(np.zeros(4), 100 * TICK, 0.0)
    made.command(FULL, 100 * TICK, 0.0)
    assert made.acts.any()


def test_nothing_acts_longer_than_its_time_out_nor_without_joint_states_nor_where_the_guard_stood_still_itself():
    made = guard(timeout=0.05)
    made.sense(105 * TICK, 0.049)
    made.look(0.05)
    assert made.acts.any()
    made.look(0.051)
    assert (made.acts.any(), made.fault) == (False, "no command for 0.051 s; expected one every 0.05 s")
    blind = guard(timeout=0.05)
    for now in (0.04, 0.06):
        blind.command(FULL, 100 * TICK, now)
    assert (blind.acts.any(), blind.fault) == (False, "no joint_states for 0.060 s; expected one every 0.05 s")
    slept = guard(timeout=0.05)
    slept.sense(400 * TICK, 3.0)
    slept.command(FULL, 400 * TICK, 3.0)
    assert not slept.acts.any()


def test_commands_of_old_sensors_are_void_until_the_bridge_rests():
    made = guard(largest_age=0.05)
    made.sense(106 * TICK, 0.01)
    made.command(FULL, 100 * TICK, 0.02)
    assert (made.acts.any(), made.fault) == (False, "a command of sensors that are 0.060 s old; expected at most 0.05")
    made.command(FULL, 106 * TICK, 0.03)
    assert not made.acts.any()
    made.command(np.zeros(4), 106 * TICK, 0.04)
    made.command(FULL, 106 * TICK, 0.04)
    assert made.acts.any()


def test_no_torque_is_larger_than_the_limit():
    made = guard()
    made.command(10 * FULL, 100 * TICK, 0.0)
    assert made.acts.tolist() == [200.0, -200.0, 200.0, 0.0]


CONTROLLERS = Path(__file__).parents[1] / "config" / "controllers.yaml"
AXES = {
    "imu_sensor_broadcaster/IMUSensorBroadcaster": (
        *(f"orientation.{axis}" for axis in "xyzw"),
        *(f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"),
    ),
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": tuple(
        f"{name}.{axis}" for name in ("force", "torque") for axis in "xyz"
    ),
}  # what each claims


def names(of: ElementTree.Element, tag: str) -> tuple[str, ...]:
    """Of the interfaces that a joint or a sensor offers."""
    return tuple(interface.attrib["name"] for interface in of.findall(tag))


def test_drives_offer_what_the_controllers_claim():
    robot = ElementTree.fromstring(robot_description())
    configured = {name: about["ros__parameters"] for name, about in yaml.safe_load(CONTROLLERS.read_text()).items()}
    joints = robot.findall("ros2_control/joint")
    assert [joint.attrib["name"] for joint in joints] == configured["effort_controller"]["joints"]
    driven = {
        joint.attrib["name"]: float(joint.find("limit").attrib["effort"]) for joint in robot.findall("joint[limit]")
    }
    assert len(joints) == len(ACTUATED) == sum(effort > 0 for effort in driven.values())
    for joint in joints:
        assert names(joint, "command_interface") == ("effort",)
        assert {"position", "velocity"} <= {*names(joint, "state_interface")}
        limits = [float(limit.text) for limit in joint.findall("command_interface/param")]
        assert limits == [-driven[joint.attrib["name"]], driven[joint.attrib["name"]]]
    sensors = {sensor.attrib["name"]: sensor for sensor in robot.findall("ros2_control/sensor")}
    kinds = {name: kind["type"] for name, kind in configured["controller_manager"].items() if isinstance(kind, dict)}
    claimed = {name: kind for name, kind in kinds.items() if kind in AXES}
    assert len(claimed) == len(sensors) == 3
    for name, kind in claimed.items():
        sensor = sensors[configured[name]["sensor_name"]]
        assert names(sensor, "state_interface") == AXES[kind]
        assert sensor.findtext("param") == configured[name]["frame_id"]
        assert robot.find(f"link[@name='{configured[name]['frame_id']}']") is not None
