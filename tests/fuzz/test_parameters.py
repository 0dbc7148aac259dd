"""Every parameter class: any values are taken or refused by name; what is taken can be used."""

import math
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pinocchio
from hypothesis import assume, example, given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError
from rabbit_description.gait import load_gait
from rabbit_sim.actuation import Actuation
from rabbit_sim.initial_state import initial_state
from rabbit_sim.mujoco_plant import MujocoPlant
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.stones import draw_course
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer

GAIT = load_gait("authors_035")
SMALL = {"hidden1": 4, "hidden2": 4, "capacity": 10}

anything = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=6), st.lists(st.floats(), max_size=3)
)


def bounds(info: Any) -> tuple[float, float]:
    """Least and largest value of a number, wide where it has none."""
    low, high = -1e6, 1e6
    for bound in info.metadata:
        low = getattr(bound, "ge", None) if getattr(bound, "ge", None) is not None else getattr(bound, "gt", low)
        high = getattr(bound, "le", None) if getattr(bound, "le", None) is not None else getattr(bound, "lt", high)
    return float(low or 0 if low is None else low), float(high if high is not None else 1e6)


def fitting(info: Any) -> st.SearchStrategy[Any]:
    """Values that may well be taken."""
    kind, (low, high) = info.annotation, bounds(info)
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if kind is bool:
        return st.booleans()
    if kind is int:
        return st.integers(math.ceil(max(low, -(2**60))), math.floor(min(high, 2**60)))
    if kind is float:
        return st.floats(low, high, allow_nan=False)
    if get_origin(kind) in (tuple, UnionType) or kind is str:
        return anything
    return st.just(info.default)


@st.composite
def likely_values_of(draw: st.DrawFn, model: type[BaseModel], *but: str) -> dict[str, Any]:
    """Some fields of a model within their own bounds; what they must be to each other may still refuse them."""
    own = {name for name, info in model.model_fields.items() if fitting(info) is not anything} - {*but}
    names = draw(st.lists(st.sampled_from(sorted(own)), max_size=5, unique=True))
    return {name: draw(fitting(model.model_fields[name])) for name in names}


def made(model: type[BaseModel], values: dict[str, Any]) -> Any:
    """The model, or None if it refuses; then it names what is wrong."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        return None if error.error_count() else error


@example({"link_bend": 1e-308}, 0)
@example({"swing_payload": 1e-12}, 0)
@example({"swing_payload": 1e-6}, 0)
@given(likely_values_of(SimulationParameters, "course"), st.integers(0, 2**64 - 1))
def test_a_plant_that_is_taken_can_be_made(values: dict[str, Any], seed: int) -> None:
    p = made(SimulationParameters, values)
    assume(p is not None)
    rng = np.random.default_rng(seed)
    assert len(draw_course(p, rng)) == p.stones
    q, dq = initial_state(p, GAIT, rng)
    assert np.isfinite([q, dq]).all()
    assert np.isfinite(Actuation(p).advance(np.full(4, 1e308))).all()
    pinocchio.buildModelFromXML(perturbed_urdf(p))
    MujocoPlant(p).close()


@given(likely_values_of(ControllerParameters))
def test_a_controller_that_is_taken_can_be_made(values: dict[str, Any]) -> None:
    p = made(ControllerParameters, values)
    assume(p is not None)
    Controller(p, GAIT, ZeroPolicy(p.problem))


@given(likely_values_of(TrainingParameters, *SMALL))
def test_a_training_that_is_taken_can_be_begun(values: dict[str, Any]) -> None:
    p = made(TrainingParameters, {**values, **SMALL})
    assume(p is not None)
    trainer = Trainer(p)
    plan = trainer.begin_episode()
    assert math.isfinite(plan.sigma)
    assert trainer.policy_file().version
