"""A program in C that walks an exported controller in MuJoCo's own library: what is written beside the controller."""

import shutil
from math import radians
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rabbit_description.state import Array, BodySensors

from rabbit_sim.engine_plant import STONE_DEPTH
from rabbit_sim.kinematics import LINK_LENGTH
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations.motors import Saturation
from rabbit_sim.perturbations.sensors import ENCODER_STEP, Laboratory
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, FOOT_RADIUS, gravity
from rabbit_sim.simulation import Simulation, flight_ticks

SOURCE = Path(__file__).with_name("example.c")
TICKS_A_STONE = 100  # in which the walk may reach it
HOOKS = "drive", "transmitted", "joint_torque", "force", "drop", "measure"  # which the program lacks
WALKED = Saturation, Laboratory  # the controller's limit is the motors'
OTHERS = (  # of whom all else is walked
    *("friction_spread", "sensor_delay", "swing_payload", "sliding_payload", "link_bend", "leg_stretch"),
    *("sole_radius", "stone_placement", "height_preview", "tick_seconds"),
)
NOISES = 4  # a tick: of the gyro's integral, two of the accelerometer, of the gyro
RULE = """# ./example --bench times a tick; MUJOCO: a folder with include/ and the library
MUJOCO = {mujoco}

example: example.c course.h controller.h controller.o $(DAQP)
	$(CC) $(FLAGS) -I$(MUJOCO)/include example.c controller.o $(DAQP) -Wl,-rpath,$(MUJOCO) {library} -lm -o $@
"""


class ExampleError(ValueError):
    """A plant that the program does not have."""


def check_plant(parameters: SimulationParameters) -> None:
    """Checks that only masses, ground and the lab's sensors differ; raises ExampleError for all else."""
    if parameters.plant != "mujoco":
        raise ExampleError(f"plant = {parameters.plant}: expected mujoco, in which the example walks")
    acting = [p for p in parameters.in_force() if any(map(p.has, HOOKS)) and not isinstance(p, WALKED)]
    for name in [*(name for p in acting for name in type(p).model_fields), *OTHERS]:
        value, usual = getattr(parameters, name), SimulationParameters.model_fields[name].default
        if value != usual and (name, parameters.sensors) != ("encoder_resolution", "lab"):
            raise ExampleError(f"{name} = {value}: expected {usual}, as the example's plant has it")


def write_example(folder: Path, simulation: Simulation, seed: int) -> None:
    """The program, its plant and the course of this seed; raises ExampleError, see `check_plant`."""
    check_plant(simulation.parameters)
    first = simulation.reset(seed)
    mujoco.mj_saveModel(simulation.plant.model, str(folder / "model.mjb"))  # type: ignore[attr-defined]
    numbers: dict[str, Any] = {"STONES": simulation.parameters.stones}
    numbers |= {"FOOT_RADIUS": FOOT_RADIUS, "STONE_DEPTH": STONE_DEPTH}
    platform, is_flat = simulation.stones[0], simulation.parameters.terrain == "flat"
    numbers |= {"PLATFORM_START": platform.near, "PLATFORM_END": platform.far, "IS_FLAT": int(is_flat)}
    numbers |= {"CLEAR_HEIGHT": CLEAR_HEIGHT, "CONTACT_FORCE": CONTACT_FORCE}
    numbers |= {"FALL_HEIGHT": simulation.parameters.fall_height, "FLIGHT_TICKS": flight_ticks(simulation.parameters)}
    numbers |= {"LINK_LENGTH": LINK_LENGTH, "MOST_TICKS": TICKS_A_STONE * simulation.parameters.stones}
    arrays = {"first_q": simulation.reading.q, "first_dq": simulation.reading.dq}
    arrays["course"] = np.array([(stone.l_min, stone.l_max, stone.height) for stone in simulation.course])
    if first.sensors:
        more, tables = errors_of_sensors(simulation, first.sensors, numbers["MOST_TICKS"])
        numbers, arrays = numbers | more, arrays | tables
    lines = [f"/* The walk of seed {seed}. */", *(f"#define {name} {value!r}" for name, value in numbers.items())]
    lines += [table(name, values) for name, values in arrays.items()]
    (folder / "course.h").write_text("\n".join([*lines, ""]))
    place = Path(mujoco.__file__).parent
    (library,) = place.glob("libmujoco.so.*")
    (folder / "example.mk").write_text(RULE.format(mujoco=place, library=library))
    shutil.copy(SOURCE, folder)


def errors_of_sensors(
    simulation: Simulation, first: BodySensors, ticks: int
) -> tuple[dict[str, float], dict[str, Array]]:
    """The errors of a lab's sensors in an episode that has begun: numbers, and tables, among them each tick's noise."""
    p, memory = simulation.parameters, simulation.memory_of(Laboratory)
    assert memory
    numbers = {"ENCODER_STEP": p.encoder_resolution or ENCODER_STEP, "GYRO_NOISE": p.gyro_noise}
    numbers |= {"ACCELEROMETER_NOISE": p.accelerometer_noise, "GYRO_BIAS": float(memory.gyro_bias)}
    numbers |= {"FIRST_ATTITUDE": first.attitude, "FIRST_PITCH_RATE": first.pitch_rate, "SLOPE": radians(p.slope)}
    numbers["ATTITUDE_ERROR"] = float(memory.attitude_error)
    tables = {"first_angles": first.joint_angles, "first_rates": first.joint_rates, "encoder_offset": memory.offset}
    tables |= {"accelerometer_bias": memory.accelerometer_bias, "fall": np.array(gravity(p.slope))}
    return numbers, tables | {"noise": memory.rng.standard_normal((ticks, NOISES))}


def table(name: str, values: Array) -> str:
    """An array in C, to the bit."""
    sizes = "".join(f"[{size}]" for size in values.shape)
    text = repr(values.tolist()).translate(str.maketrans("[]", "{}"))
    return f"static const double {name}{sizes} = {text};"
