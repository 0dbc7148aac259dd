"""The numbers of the page that are Python's: controllers, gaits, constants of the plant, courses and first states."""

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
from cbf_clf_qp.constraints import ResClf
from cbf_clf_qp.functions import Layout, Place
from rabbit_description.gait import load_gaits
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.walk_records import drawn_parameters
from rabbit_sim import engine_plant, mujoco_plant, plant, simulation, terrain, touchdown_detector
from rabbit_sim.initial_state import initial_state
from rabbit_sim.kinematics import LINK_LENGTH
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.stones import draw_course
from rabbit_viewer.geometry import TORSO
from rabbit_viewer.page.rows import RowMaker
from rabbit_viewer.play.settings import controls
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.export import report_of, tables_of
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PROBE

LEARNING = {"controller": "rl-cbf-clf-qp", "qp_solver": "daqp"}
CONTROLLERS: dict[str, tuple[ControllerParameters, str]] = {  # parameters, policy
    "best": (load_parameters("best"), "zero"),
    "nominal, tuned": (load_parameters("nominal_tuned", qp_solver="daqp"), "zero"),
    "learned": (load_parameters("ours", **LEARNING), RL_CBF_CLF_QP.name),
    "nominal, same gain": (load_parameters("ours", **LEARNING), "zero"),
}
PLANT = SimulationParameters(plant="mujoco")
SEEDS, MASS_SCALE = range(1, 41), 0.5  # as README compares them
SHOWN = ("mass_scale", "payload", "ground_friction", "stone_width", "seed", "again")  # of the controls of `rabbit play`
EPS = {"minimum": 0.02, "maximum": 0.1, "step": 0.005, "when": "now"}


def controllers() -> dict[str, Controller]:
    """The page's controllers, by name."""
    return {
        name: Assembly(PLANT, parameters, resolve_policy(policy, parameters)).make_controller()
        for name, (parameters, policy) in CONTROLLERS.items()
    }


def page_numbers(made: Mapping[str, Controller]) -> dict[str, Any]:
    """All of them, for JSON."""
    gaits = {walker.parameters.gait for walker in made.values()}
    learned = next(walker.policy for walker in made.values() if isinstance(walker.policy, ActorPolicy))
    return {
        "controllers": {name: controller(i, walker) for i, (name, walker) in enumerate(made.items())},
        "plant": plant_numbers(),
        "courses": [course(seed, gaits) for seed in SEEDS],
        "controls": page_controls(),
        "policy": policy_numbers(learned),
    }


def controller(number: int, made: Controller) -> dict[str, Any]:
    """What `controller.js` and the page's drawing need of a controller."""
    parameters, f = made.parameters, made.functions
    about = {
        **drawn_parameters(parameters),
        **{"quantities": list(made.qp.names), "barriers": list(made.barrier_names)},
        "clf_rate": ResClf(4, 1.0, (parameters.kp, parameters.kd)).rate,  # at eps = 1
    }
    report = report_of(made)
    is_learned = isinstance(made.policy, ActorPolicy)
    inside = {"seen": f.seen.places, "answer": f.answer.places}
    inside |= {"adapted": f.estimates.places} if f.identifies and not is_learned else {}
    places = ends_of(report.places)
    for name, parts in inside.items():
        places |= ends_of(parts, places[name][0])
    return {
        **{"module": f"controller_{number}.wasm", "gait": parameters.gait, "is_learned": is_learned},
        **{"parameters": parameters.model_dump(mode="json"), "about": about, "tick_seconds": TICK_SECONDS},
        **{"memory": row(f.memory), "reading": row(f.reading), "settings": row(f.settings)},
        "report": {**row(report), "places": places},
        "columns": RowMaker(about, made.qp.names, made.barrier_names).columns,
    }


def row(layout: Layout) -> dict[str, Any]:
    """The row's size, and the place of each part."""
    return {"size": layout.size, "places": ends_of(layout.places)}


def ends_of(places: Mapping[str, Place], start: int = 0) -> dict[str, list[int]]:
    """Begin and end of each part."""
    return {name: [start + place.start, start + place.stop] for name, (place, _) in places.items()}


def plant_numbers() -> dict[str, Any]:
    """The constants of the plant, and MuJoCo's XML with words in place of what the page changes."""
    robot = ElementTree.fromstring(
        mujoco_plant.robot_mjcf(perturbed_urdf(PLANT), PLANT.ground_friction, PLANT.sole_radius)
    )
    links = {}
    for body in robot.iterfind(".//body"):
        if (inertial := body.find("inertial")) is not None:
            name = body.attrib["name"]
            mass, pos, inertia = (inertial.attrib[key] for key in ("mass", "pos", "diaginertia"))
            links[name] = {"mass": float(mass), "pos": numbers(pos), "inertia": numbers(inertia)}
            inertial.attrib.update(mass=f"@{name}_mass", pos=f"@{name}_pos", diaginertia=f"@{name}_inertia")
    for geom in robot.iterfind(".//geom[@friction]"):
        geom.set("friction", "@friction 0 0")
    return {
        **{"mjcf": ElementTree.tostring(robot, encoding="unicode"), "links": links},
        **{name: getattr(PLANT, name) for name in ("payload_height", "ground_stiffness", "ground_damping", "stones")},
        **{name: getattr(PLANT, name) for name in ("torque_limit", "fall_height", "fall_pitch")},
        **{"substeps": plant.SUBSTEPS, "substep_seconds": plant.SUBSTEP_SECONDS, "tick_seconds": TICK_SECONDS},
        **{"contact_force": plant.CONTACT_FORCE, "clear_height": plant.CLEAR_HEIGHT, "foot_radius": plant.FOOT_RADIUS},
        **{"farthest_edge": plant.FARTHEST_EDGE, "platform_start": terrain.PLATFORM_START},
        **{"kept_stones": terrain.KEPT_STONES, "stone_depth": engine_plant.STONE_DEPTH, "away": mujoco_plant.AWAY},
        **{"impedance": mujoco_plant.IMPEDANCE, "edge_depth": touchdown_detector.EDGE_DEPTH},
        "fastest_fall": touchdown_detector.FASTEST_FALL,
        "flight_ticks": round(simulation.FLIGHT_SECONDS / TICK_SECONDS),
        **{"slip_friction": simulation.SLIP_FRICTION, "slip_distance": simulation.SLIP_DISTANCE},
        **{"stall_ticks": simulation.stall_ticks(PLANT), "link_length": LINK_LENGTH, "torso_length": TORSO},
    }


def numbers(text: str) -> list[float]:
    """The numbers of an attribute."""
    return [float(word) for word in text.split()]


def course(seed: int, gaits: set[str]) -> dict[str, Any]:
    """The stones' near edges and, by gait, the first state of an episode; as `Simulation.reset` draws them."""
    course_rng, _, _ = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3))
    starts = {}
    for name in gaits:
        _, start_rng, _ = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3))
        q, dq = initial_state(PLANT, load_gaits(name), start_rng)
        starts[name] = {"q": q.tolist(), "dq": dq.tolist()}
    return {"near": [stone.l_min for stone in draw_course(PLANT, course_rng)], "starts": starts}


def page_controls() -> list[dict[str, Any]]:
    """What a person can choose; see `rabbit_viewer.play.settings.controls`."""
    known = {control["name"]: control for control in controls()}
    known["stone_width"]["when"] = "now"
    known["again"]["default"] = "next course"
    known["mass_scale"]["default"], known["seed"]["default"] = MASS_SCALE, SEEDS[0]
    known["seed"]["maximum"], known["seed"]["minimum"] = SEEDS[-1], SEEDS[0]
    names = list(CONTROLLERS)
    return [
        {"name": "first", "title": "controller", "enum": names, "default": names[0], "when": "now"},
        {"name": "second", "title": "on the same course", "enum": [*names, "none"], "default": names[1], "when": "now"},
        {"name": "first_eps", "title": "eps of the first", "default": CONTROLLERS[names[0]][0].eps, **EPS},
        {"name": "second_eps", "title": "eps of the second", "default": CONTROLLERS[names[1]][0].eps, **EPS},
        *(known[name] for name in SHOWN),
    ]


def policy_numbers(policy: ActorPolicy) -> dict[str, Any]:
    """What `policy.js` checks a policy file against, and the sizes of the module's tables."""
    problem = RL_CBF_CLF_QP
    observations = [names for names in problem.observations if not set(names).intersection(problem.optional)]
    tables = {name: values.size for name, values in tables_of(policy).items()}
    sizes = {"layers": policy.actor.sizes.tolist(), "widest": policy.actor.widest, "units": policy.actor.units}
    return {"problem": problem.name, "observations": observations, "tables": tables, "probe": PROBE, **sizes}
