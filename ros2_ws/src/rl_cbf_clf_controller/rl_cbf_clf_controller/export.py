"""A controller as C source: `controller.c`, its header, and DAQP, for a program without Python.

    double memory[MEMORY_SIZE], reading[READING_SIZE], settings[SETTINGS_SIZE], report[REPORT_SIZE];
    controller_first(memory);                  /* an episode begins */
    controller_settings(settings);             /* the gains as they were exported */
    controller_step(memory, reading, settings, report);   /* a tick: report[REPORT_COMMAND] is the torque */

The C code is what CasADi writes of `step.py`, so a tick has the bits that it has in Python. It opens no file and takes
no lock; what DAQP allocates comes from a static buffer of the thread. With a state estimator, whose memory and settings
follow the controller's in these rows, `controller_step_from_sensors` goes from encoders, IMU and feet to torque.
"""

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from cbf_clf_qp.compiled import c_of
from cbf_clf_qp.functions import Layout, NumpyFunction
from rabbit_description.state import Array

from rl_cbf_clf_controller.controller import OneRobot
from rl_cbf_clf_controller.network import SOURCE
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy
from rl_cbf_clf_controller.step import NOT_FINITE, STONE

KINDS = {"d": "double", "f": "float", "l": "long long"}  # by numpy's letter
RIDE = Path(__file__).with_name("ride_example.c")
ARENA = 1 << 16  # bytes, of which a QP takes some 10 k
STATIC = "#define CASADI_SYMBOL_EXPORT static /* glibc has a function `step` of its own */\n"
HEADER = """/* {about}

Rows of numbers, double, by name: what lies at NAME, and how many. Units are SI: m, s, rad, N, N m.
A reading without a stone has NAN there; torques that are not known are NAN. Legs: 0 left, 1 right; a task's state
stands on 0.
*/
#ifndef CONTROLLER_H
#define CONTROLLER_H

{rows}
{policy}void controller_first(double *memory);
void controller_settings(double *settings);

/* One tick. 0: done. The reading is refused, and the memory as it was: 1 q, 2 dq, 3 stone, or a task's
   parameters. A fault, which ends an
   episode: 4 another count of touchdowns, 5 no answer to the QP, 6 numbers that are not finite. */
int controller_step(double *memory, const double *reading, const double *settings, double *report);
{sensing}
#endif
"""
SENSING = """
/* The same of a reading without what is in the sensors, which fills it in, q and dq as estimated. Further refusals:
   {refusals}. */
int controller_step_from_sensors(double *memory, const double *sensors, double *reading, const double *settings,
                                 double *report);
"""
WRAPPER = """
#include <string.h>
#include "controller.h"

static _Thread_local double arena[{arena} / sizeof(double)];
static _Thread_local size_t arena_used;

/* DAQP calls these: it is compiled with their names in place of malloc and free */
void *controller_malloc(size_t size) {{
  size_t numbers = (size + sizeof(double) - 1) / sizeof(double);
  if (arena_used + numbers > sizeof arena / sizeof(double)) return 0;
  arena_used += numbers;
  return arena + arena_used - numbers;
}}

void controller_free(void *memory) {{ (void)memory; }}

{tables}
static _Thread_local const double *arguments[{arguments}];
static _Thread_local double *results[{results}], numbers[{numbers}];
static _Thread_local long long integers[{integers}];

void controller_first(double *memory) {{ memcpy(memory, first, sizeof first); }}
void controller_settings(double *settings) {{ memcpy(settings, usual, sizeof usual); }}

int controller_step(double *memory, const double *reading, const double *settings, double *report) {{
  arena_used = 0;
  arguments[0] = memory, arguments[1] = reading, arguments[2] = settings, arguments[3] = gaits;
  results[0] = report;
{tick}  if (report[REPORT_REFUSED] != 0) return (int)report[REPORT_REFUSED];
  memcpy(memory, report + REPORT_MEMORY, {kept} * sizeof(double));
  return report[REPORT_FAULT] != 0 ? {refusals} + (int)report[REPORT_FAULT] : 0;
}}
{sensing}"""
MAKEFILE = """# make, then ./example
FLAGS = -O2 -fno-builtin -ffp-contract=off -w -Idaqp/include -Idaqp/include/daqp
DAQP = $(or $(patsubst %.c,%.o,$(wildcard daqp/src/*.c)),daqp/daqp.a)

all: example

-include example.mk

controller.o: controller.c controller.h
	$(CC) $(FLAGS) -c $< -o $@

# DAQP takes its memory from controller.c
daqp/src/%.o: daqp/src/%.c
	$(CC) $(FLAGS) -Dmalloc=controller_malloc -Dfree=controller_free -c $< -o $@

daqp/daqp.a: daqp/libdaqpstat.a
	objcopy --redefine-sym malloc=controller_malloc --redefine-sym free=controller_free $< $@
"""
LINK = "\t$(CC) $(FLAGS) example.c controller.o $(DAQP) -lm -o $@\n"
STEP = """  step(arguments, results, integers, numbers, 0);
"""
LEARNED = """  static _Thread_local double scaled[{inputs}], network[{widest} + {units}];
  double *outputs = network + {widest} + {units} - {outputs};
  look(arguments, results, integers, numbers, 0);
  for (int i = 0; i < policy_sizes[0]; i++)
    scaled[i] = (report[SEEN_OBSERVATION + i] - policy_center[i]) * policy_inverse_scale[i];
  policy_forward(1, policy_sizes, {widest}, policy_weights, policy_biases, scaled, network);
  arguments[0] = outputs, arguments[1] = report + SEEN_LGV, results[0] = report + REPORT_ALPHA;
  arguments[2] = policy_alpha_scale, arguments[3] = policy_beta_scale;
  estimates(arguments, results, integers, numbers, 0);
{adapted}  arguments[0] = reading, arguments[1] = settings, arguments[2] = report;
  arguments[3] = report + REPORT_ALPHA, results[0] = report + REPORT_MEMORY;
  decide(arguments, results, integers, numbers, 0);
"""
POLICY = """/* The policy, which another one of the same form may replace between two ticks */
{tables}

"""
ADAPTED = """  for (int i = 0; i < {estimated}; i++) report[REPORT_ALPHA + i] += report[REPORT_ADAPTED + i];
"""
SENSED = """
int controller_step_from_sensors(double *memory, const double *sensors, double *reading, const double *settings,
                                 double *report) {{
  static _Thread_local double estimated[{size}];
  int code;
  arguments[0] = memory + MEMORY_ESTIMATOR, arguments[1] = sensors, arguments[2] = settings + {settings};
  results[0] = estimated;
  estimate_state(arguments, results, integers, numbers, 0);
  if (estimated[{refused}] != 0) return {codes} + (int)estimated[{refused}];
{filled}  code = controller_step(memory, reading, settings, report);
  if (report[REPORT_REFUSED] == 0) memcpy(memory + MEMORY_ESTIMATOR, estimated, {memory} * sizeof(double));
  return code;
}}
"""
CODES = STONE + NOT_FINITE  # of a controller


class ExportError(ValueError):
    """What cannot be exported, and what was expected."""


@dataclass(frozen=True)
class StateEstimator:
    """A `function` of rows memory, sensors and settings: the row `memory` after the tick, `q`, `dq` and `refused`.

    `usual`: the settings; `first`: the memory before tick 0; `refusals`: what `refused` says, from 1.
    """

    function: NumpyFunction
    memory: Layout
    sensors: Layout
    settings: Layout
    usual: Array
    first: Array
    refusals: Sequence[str]


def export(
    controller: OneRobot, folder: Path, daqp: Path | None = None, estimator: StateEstimator | None = None
) -> None:
    """Write the controller into a folder, with an `estimator` that makes its readings of sensors.

    `daqp`: the folder `csrc` of DAQP's source package, which is copied. None: the library that is in CasADi's wheel.
    Raises ExportError for a controller whose tick is not one function of C.
    """
    policy, f = controller.robots.policies[0], controller.functions
    needs_structure = controller.qp.needs_output_error
    is_actor = isinstance(policy, ActorPolicy) and (policy.is_structured or not needs_structure)
    if not (is_actor or type(policy) is ZeroPolicy) or controller.solvers[0] != "daqp":
        raise ExportError(
            f"controller {controller.name}, policy {policy.version}, solver {controller.solvers[0]}: "
            "expected policy zero or a structured one, daqp"
        )
    functions = [f.step]
    if isinstance(policy, ActorPolicy):
        functions = [f.look, policy.estimates, f.decide]
    if estimator:
        functions.append(estimator.function)
    text = c_of(*(function.function for function in functions))
    if text is None:
        raise ExportError("the tick: expected functions of which CasADi can write C")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "controller.c").write_text(STATIC + text + wrapper(controller, functions, estimator))
    (folder / "controller.h").write_text(header(controller, estimator))
    (folder / "Makefile").write_text(MAKEFILE)
    copy_daqp(folder / "daqp", daqp)


def export_ride(folder: Path, readings: Array, inputs: Array) -> None:
    """Beside an exported controller, a program that gives it the `readings` (ticks, size) of a ride.

    It compares its answers with `inputs` (ticks, m).
    """
    lines = [f"#define TICKS {len(readings)}"]
    for name, rows in {"readings": readings, "inputs": inputs}.items():
        table = ",\n  ".join(map(numbers, rows))
        lines.append(f"static const double {name}[{len(rows)}][{rows.shape[1]}] = {{\n  {table}}};")
    (folder / "ride.h").write_text("\n".join([*lines, ""]))
    (folder / "example.mk").write_text("example: example.c ride.h controller.h controller.o $(DAQP)\n" + LINK)
    shutil.copy(RIDE, folder / "example.c")


def header(controller: OneRobot, estimator: StateEstimator | None) -> str:
    """The rows by name."""
    f, memory, settings, sensing = controller.functions, controller.functions.memory, controller.functions.settings, ""
    rows: dict[str, tuple[Layout, int]] = {}
    if estimator:
        refusals = ", ".join(f"{code} {why}" for code, why in enumerate(estimator.refusals, CODES + 1))
        sensing = SENSING.format(refusals=refusals)
        rows["sensors"] = estimator.sensors, 0
        rows["estimator"] = estimator.memory, memory.size
        memory = Layout(memory.sizes | {"estimator": estimator.memory.size})
        settings = Layout(settings.sizes | estimator.settings.sizes)
    rows = {"memory": (memory, 0), "reading": (f.reading, 0), "settings": (settings, 0)} | rows
    rows["report"] = report_of(controller), 0
    for name, function in (("seen", f.seen), ("answer", f.answer)):
        rows[name] = Layout.of(function), f.report.places[name][0].start
    lines = [line for name, (layout, start) in rows.items() for line in (*defines(name, layout, start), "")]
    rows_of_qp = ", ".join(controller.qp.layout.names)
    about = f"{controller.name}: the QP has the rows {rows_of_qp}; SEEN and ANSWER are in a report"
    about += ", ESTIMATOR in a memory" if estimator else ""
    policy = ""
    if isinstance(controller.robots.policies[0], ActorPolicy):
        tables = (f"extern {declared(*table)};" for table in tables_of(controller.robots.policies[0]).items())
        policy = POLICY.format(tables="\n".join(tables))
    return HEADER.format(about=about, rows="\n".join(lines), policy=policy, sensing=sensing)


def report_of(controller: OneRobot) -> Layout:
    """The report; with a learned policy also all estimates."""
    f, is_learned = controller.functions, isinstance(controller.robots.policies[0], ActorPolicy)
    return Layout(f.report.sizes | f.estimates.sizes) if is_learned else f.report


def tables_of(policy: ActorPolicy) -> dict[str, Array]:
    """The policy's numbers; see `forward` in `network.c`, and `estimate_function`."""
    actor, (alpha, beta) = policy.actor, policy.scales
    tables = {"center": policy.center, "inverse_scale": policy.inverse_scale, "alpha_scale": alpha, "beta_scale": beta}
    tables |= {"weights": actor.weights, "biases": actor.biases, "sizes": actor.sizes}
    return {f"policy_{name}": values for name, values in tables.items()}


def defines(row: str, layout: Layout, start: int) -> Iterable[str]:
    """A line for each part of a row, which begins at `start` of another one if it is not 0."""
    if not start:
        yield f"#define {row.upper()}_SIZE {layout.size}"
    for name, (place, _) in layout.places.items():
        yield f"#define {row.upper()}_{name.upper()} {start + place.start} /* {place.stop - place.start} */"


def wrapper(controller: OneRobot, functions: Sequence[NumpyFunction], estimator: StateEstimator | None) -> str:
    """What is called, with the tables that it hands out."""
    f, policy, tick, network = controller.functions, controller.robots.policies[0], STEP, ""
    first = controller.first_memory()
    usual = np.array([getattr(controller.parameters, name, 0.0) for name in f.settings.places])
    if estimator:
        first, usual = np.append(first, estimator.first), np.append(usual, estimator.usual)
    tables = {"first": first, "usual": usual, "gaits": f.gaits}
    if isinstance(policy, ActorPolicy):
        actor = policy.actor
        sizes = {"inputs": len(policy.center), "widest": actor.widest, "units": actor.units, "outputs": actor.outputs}
        adapted = ADAPTED.format(estimated=policy.estimates.row.size) if f.identifies else ""
        tick, network = LEARNED.format(adapted=adapted, **sizes), SOURCE.read_text()
        network = network.replace("\nvoid layer(", "\nstatic void layer(")
        network = network.replace("void forward(", "void policy_forward(")
        network += "\n".join(f"{declared(*table)} = {numbers(table[1])};" for table in tables_of(policy).items())
    most = {
        "arguments": max(function.function.sz_arg() for function in functions),
        "results": max(function.function.sz_res() for function in functions),
        "integers": max(function.function.sz_iw() for function in functions),
        "numbers": max(function.function.sz_w() for function in functions),
    }
    constant = (f"static const {declared(name, values)} = {numbers(values)};" for name, values in tables.items())
    written = "\n".join((network, *constant))
    most |= {"arena": ARENA, "kept": f.memory.size, "refusals": STONE}
    return WRAPPER.format(tables=written, tick=tick, sensing=sensed(controller, estimator), **most)


def sensed(controller: OneRobot, estimator: StateEstimator | None) -> str:
    """The call from sensors, or nothing."""
    if not estimator:
        return ""
    of, reading, f = estimator.function.places, controller.functions.reading, controller.functions
    copies = {name: f"sensors + {place.start}" for name, (place, _) in estimator.sensors.places.items()}
    copies |= {name: f"estimated + {of[name][0].start}" for name in ("q", "dq")}
    lines = (
        f"  memcpy(reading + READING_{name.upper()}, {copies[name]}, {size} * sizeof(double));\n"
        for name, size in reading.sizes.items()
        if name in copies
    )
    sizes = {"size": estimator.function.row.size, "memory": estimator.memory.size, "settings": f.settings.size}
    return SENSED.format(filled="".join(lines), codes=CODES, refused=of["refused"][0].start, **sizes)


def declared(name: str, values: Array) -> str:
    """An array in C."""
    return f"{KINDS[values.dtype.char]} {name}[{values.size}]"


def numbers(values: Array) -> str:
    """The numbers of an array in C, to the bit."""
    return f"{{{', '.join(map(number, values.tolist()))}}}"


def number(value: float) -> str:
    """One of them."""
    if np.isfinite(value):
        return repr(value)
    return "NAN" if np.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"


def copy_daqp(folder: Path, source: Path | None) -> None:
    """Source, or library, with headers and licence."""
    wheel = Path(ca.__file__).parent
    headers, licence = wheel / "include" / "daqp", wheel / "include" / "licenses" / "daqp-external" / "LICENSE"
    if source is not None:
        if not (source / "src").is_dir():
            raise ExportError(f"daqp {source}: expected the folder csrc of DAQP's source, with include and src")
        headers, licence = source / "include", source.parent / "LICENSE"
        shutil.copytree(source / "src", folder / "src", dirs_exist_ok=True)
    shutil.copytree(headers, folder / "include" / "daqp", dirs_exist_ok=True)
    if source is None:
        shutil.copy(wheel / "libdaqpstat.a", folder)
    shutil.copy(licence, folder / "LICENSE")
