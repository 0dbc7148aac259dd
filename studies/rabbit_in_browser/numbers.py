"""The numbers of the page that are Python's: controllers, gaits, constants of the plant, courses and first states."""

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
from cbf_clf_qp.answer import TOLERANCE
from cbf_clf_qp.constraints import ResClf
from rabbit_description.gait import GaitLibrary, load_gaits
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.conditions import TRAINING_SCALE
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
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.walking import GAINS
from rl_cbf_clf_controller.weights import PROBE

from rabbit_in_browser.tick_in_c import TickInC, policy_shapes

LEARNING = {"controller": "rl-cbf-clf-qp"}
CONTROLLERS: dict[str, tuple[ControllerParameters, str]] = {  # parameters, policy
    "learned": (load_parameters("ours", **LEARNING), "learned"),
    "nominal, tuned": (load_parameters("nominal_tuned"), "zero"),
    "nominal, same gain": (load_parameters("ours", **LEARNING), "zero"),
}
PLANT = SimulationParameters(plant="mujoco")
SEEDS = range(1, 41)
SHOWN = ("mass_scale", "payload", "ground_friction", "stone_width", "seed", "again")  # of the controls of `rabbit play`
EPS = {"minimum": 0.02, "maximum": 0.1, "step": 0.005, "when": "now"}


def page_numbers(ticks: Mapping[str, TickInC]) -> dict[str, Any]:
    """All of them, for JSON; `ticks` by objective."""
    parameters = {name: each for name, (each, _) in CONTROLLERS.items()}
    return {
        "controllers": {name: controller(*each, ticks[each[0].objective]) for name, each in CONTROLLERS.items()},
        "gaits": {each.gait: gait(each.gait) for each in parameters.values()},
        "plant": plant_numbers(),
        "courses": [course(seed, {each.gait for each in parameters.values()}) for seed in SEEDS],
        "controls": page_controls(),
        "policy": policy_numbers(),
    }


def controller(parameters: ControllerParameters, policy: str, tick: TickInC) -> dict[str, Any]:
    """What `controller.js` and the page's drawing need of a controller."""
    robot, places = read_robot(), tick.parameters
    p = np.zeros(max(place.stop for place, _ in places.values()))
    p[: robot.row.size] = robot.row
    for name in GAINS:
        p[places[name][0]] = getattr(parameters, name)
    quantities, barriers = list(parameters.problem.quantities), ["B1", "B2"]
    about = {
        **drawn_parameters(parameters),
        **{"quantities": quantities, "barriers": barriers, "rescues": tick.layout.rescues.tolist()},
        "clf_rate": ResClf(4, 1.0, (parameters.kp, parameters.kd)).rate,  # at eps = 1
    }
    return {
        **{name: getattr(parameters, name) for name in ("gait", "stone_aim", "swap_time", "swap_phase")},
        **{"tick": parameters.objective, "policy": policy, "p": p.tolist(), "tick_seconds": TICK_SECONDS},
        "places": {name: [place.start, place.stop] for name, (place, _) in places.items()},
        **{"tolerance": TOLERANCE, "left": tick.function.size1_in("before")},
        **{"joints": robot.joints.ravel().tolist(), "feet": robot.feet.ravel().tolist()},
        **{"about": about, "columns": RowMaker(about, quantities, barriers).columns},
    }


def gait(name: str) -> dict[str, Any]:
    """Of a gait, or of a library for level ground."""
    gaits = load_gaits(name)
    known = gaits.rows[0] if isinstance(gaits, GaitLibrary) else [gaits]
    start_length = gaits.start_length if isinstance(gaits, GaitLibrary) else 0.0
    paths = [
        {"coeffs": each.coeffs.tolist(), "start": each.phase_angle_start, "end": each.phase_angle_end} for each in known
    ]
    return {"lengths": [each.step_length for each in known], "paths": paths, "start_length": start_length}


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
        **{
            "fastest_fall": touchdown_detector.FASTEST_FALL,
            "flight_ticks": round(simulation.FLIGHT_SECONDS / TICK_SECONDS),
        },
        **{"slip_friction": simulation.SLIP_FRICTION, "slip_distance": simulation.SLIP_DISTANCE},
        **{
            "stall_ticks": round(simulation.STALL_SECONDS / TICK_SECONDS),
            "link_length": LINK_LENGTH,
            "torso_length": TORSO,
        },
    }


def numbers(text: str) -> list[float]:
    """Of an attribute."""
    return [float(each) for each in text.split()]


def course(seed: int, gaits: set[str]) -> dict[str, Any]:
    """The stones' near edges and, by gait, the first state of an episode; as `Simulation.reset` draws them."""
    course_rng, _, _ = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(3))
    starts = {}
    for name in gaits:
        _, start_rng, _ = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(3))
        q, dq = initial_state(PLANT, load_gaits(name), start_rng)
        starts[name] = {"q": q.tolist(), "dq": dq.tolist()}
    return {"near": [stone.l_min for stone in draw_course(PLANT, course_rng)], "starts": starts}


def page_controls() -> list[dict[str, Any]]:
    """What a person can choose; see `rabbit_viewer.play.settings.controls`."""
    known = {each["name"]: each for each in controls()}
    known["stone_width"]["when"] = "now"
    known["again"]["default"] = "next course"
    known["mass_scale"]["default"], known["seed"]["default"] = TRAINING_SCALE, SEEDS[0]  # the robot that was learned
    known["seed"]["maximum"], known["seed"]["minimum"] = SEEDS[-1], SEEDS[0]
    names = list(CONTROLLERS)
    return [
        {"name": "first", "title": "controller", "enum": names, "default": names[0], "when": "now"},
        {"name": "second", "title": "on the same course", "enum": [*names, "none"], "default": names[1], "when": "now"},
        {"name": "first_eps", "title": "eps of the first", "default": CONTROLLERS[names[0]][0].eps, **EPS},
        {"name": "second_eps", "title": "eps of the second", "default": CONTROLLERS[names[1]][0].eps, **EPS},
        *(known[name] for name in SHOWN),
    ]


def policy_numbers() -> dict[str, Any]:
    """What `policy.js` checks a policy file against."""
    problem, shapes = RL_CBF_CLF_QP, policy_shapes(RL_CBF_CLF_QP)
    observations = [names for names in problem.observations if not set(names).intersection(problem.optional)]
    probe = {"name": PROBE, "outputs": shapes["2.bias"][0]}
    return {"problem": problem.name, "observations": observations, "shapes": shapes, "probe": probe}
