"""What can be chosen: within bounds, and as the plant and the controllers understand it."""

import json
from functools import partial
from typing import Any

import pytest
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.play.serving import Door, check_walk
from rabbit_viewer.play.settings import (
    CONTROLLERS,
    PLANT_AT_ONCE,
    ROBOTS,
    PlaySettings,
    Start,
    controller_of,
    controls,
    plant_of,
    settings_of,
)
from rl_cbf_clf_controller.parameters import ControllerParameters


def test_settings_reach_the_plant() -> None:
    plant = plant_of(SimulationParameters(joint_damping=1.5), PlaySettings(mass_scale=2.5, motor_power=0.8, payload=9))
    assert (plant.mass_scale, plant.motor_loss, plant.payload) == (2.5, pytest.approx(0.2), 9)
    assert plant.joint_damping == 1.5  # of the command line, beneath the settings


def test_a_plant_gives_its_settings_and_back() -> None:
    plant = SimulationParameters(mass_scale=1.4, motor_loss=0.25, torque_delay=0.003, l_min_std=0.03, stones=7)
    assert plant_of(plant, settings_of(plant)) == plant


TIMES = [("torque_delay", time) for time in (0.001, 0.0123, 0.017000000000000001, 0.03)]


@pytest.mark.parametrize(("name", "time"), [*TIMES, ("sensor_jitter", 0.0123)])
def test_any_time_of_a_slider_is_whole_substeps(name: str, time: float) -> None:
    plant = plant_of(SimulationParameters(), PlaySettings.model_validate({name: time}))
    assert getattr(plant, name) == pytest.approx(time, abs=5e-4)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_choice_is_a_controller(name: str) -> None:
    parameters, policy = controller_of(ControllerParameters(friction_margin=0.1), name)
    assert parameters.friction_margin == 0.1
    assert policy in ("zero", "oracle", "rl-cbf-clf-qp")


def test_the_page_gets_each_field_with_bounds_or_choices() -> None:
    described = {control["name"]: control for control in controls()}
    assert described.keys() == PlaySettings.model_fields.keys()
    at_once = {name for name, control in described.items() if control["when"] == "now"}
    assert at_once == {*ROBOTS, *PLANT_AT_ONCE, "again"}
    for control in described.values():
        assert control["title"]
        assert control["when"] in ("now", "reset")
        assert "enum" in control or control["minimum"] < control["maximum"]


@pytest.mark.parametrize(
    "message",
    [
        {"do": "set", "settings": {"mass_scale": 99}},
        {"do": "set", "settings": {"first": "none"}},
        {"do": "set", "settings": {"colour": "red"}},
        {"do": "begin", "settings": {"payload": -1}},
        {"do": "begin", "settings": {"first": "none"}},
        {"do": "begin", "settings": {"push.30": "200_0.1"}},
        {"do": "push", "force": 1e9},
        {"do": "push", "force": "nan"},
        {"do": "speed", "speed": 0},
        {"do": "pause", "paused": None},
        {"do": "fly"},
        {},
    ],
)
def test_what_is_out_of_bounds_is_refused(message: dict[str, Any]) -> None:
    passed: list[Any] = []
    start = Start(settings=PlaySettings(), plant=SimulationParameters(), controller=ControllerParameters())
    assert Door(partial(check_walk, start), passed.append)(json.dumps(message))
    assert not passed
