"""A program in C that walks an exported controller in MuJoCo's own library: what is written beside the controller."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
from rabbit_description.state import Array

from rabbit_sim.engine_plant import STONE_DEPTH
from rabbit_sim.kinematics import LINK_LENGTH
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, FOOT_RADIUS
from rabbit_sim.simulation import Simulation, flight_ticks
from rabbit_sim.terrain import PLATFORM_START

SOURCE = Path(__file__).with_name("example.c")
MAKEFILE = """# make, then ./example, or ./example --bench; MUJOCO: a folder with include/ and the library
MUJOCO = {mujoco}
FLAGS = -O2 -fno-builtin -ffp-contract=off -w -Idaqp/include -Idaqp/include/daqp
DAQP = $(or $(patsubst %.c,%.o,$(wildcard daqp/src/*.c)),daqp/daqp.a)

example: example.c course.h controller.h controller.o $(DAQP)
	$(CC) $(FLAGS) -I$(MUJOCO)/include example.c controller.o $(DAQP) -Wl,-rpath,$(MUJOCO) {library} -lm -o $@

controller.o: controller.c controller.h
	$(CC) $(FLAGS) -c $< -o $@

# DAQP takes its memory from controller.c
daqp/src/%.o: daqp/src/%.c
	$(CC) $(FLAGS) -Dmalloc=controller_malloc -Dfree=controller_free -c $< -o $@

daqp/daqp.a: daqp/libdaqpstat.a
	objcopy --redefine-sym malloc=controller_malloc --redefine-sym free=controller_free $< $@
"""


def write_example(folder: Path, simulation: Simulation, seed: int) -> None:
    """The program, its plant and the course of this seed, of a MuJoCo plant without further perturbations."""
    state = simulation.reset(seed)
    mujoco.mj_saveModel(simulation.plant.model, str(folder / "model.mjb"))  # type: ignore[attr-defined]
    numbers = {"STONES": simulation.parameters.stones, "FOOT_RADIUS": FOOT_RADIUS, "STONE_DEPTH": STONE_DEPTH}
    numbers |= {"PLATFORM_START": PLATFORM_START, "PLATFORM_END": simulation.parameters.stone_width / 2}
    numbers |= {"CLEAR_HEIGHT": CLEAR_HEIGHT, "CONTACT_FORCE": CONTACT_FORCE}
    numbers |= {"FALL_HEIGHT": simulation.parameters.fall_height, "FLIGHT_TICKS": flight_ticks(simulation.parameters)}
    numbers["LINK_LENGTH"] = LINK_LENGTH
    lines = [f"/* The walk of seed {seed}. */", *(f"#define {name} {value!r}" for name, value in numbers.items())]
    lines += [f"static const double {name}[] = {braces(value)};" for name, value in start_of(state)]
    stones = ", ".join(braces((stone.l_min, stone.l_max, stone.height)) for stone in simulation.course)
    (folder / "course.h").write_text("\n".join([*lines, f"static const double course[STONES][3] = {{{stones}}};\n"]))
    place = Path(mujoco.__file__).parent
    (library,) = place.glob("libmujoco.so.*")
    (folder / "Makefile").write_text(MAKEFILE.format(mujoco=place, library=library))
    shutil.copy(SOURCE, folder)


def start_of(state: Any) -> Iterable[tuple[str, Array]]:
    """With which the walk begins, by its name in C."""
    return ("first_q", state.q), ("first_dq", state.dq)


def braces(values: Iterable[float]) -> str:
    """Numbers in C, to the bit."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"
