"""What can be chosen: within bounds, and as the plant and the controllers understand it."""

import pytest
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.play.settings import PlaySettings, plant_of


def test_settings_reach_the_plant() -> None:
    plant = plant_of(SimulationParameters(joint_damping=1.5), PlaySettings(mass_scale=2.5, motor_power=0.8, payload=9))
    assert (plant.mass_scale, plant.motor_loss, plant.payload) == (2.5, pytest.approx(0.2), 9)
    assert plant.joint_damping == 1.5  # of the command line, beneath the settings


TIMES = [("torque_delay", time) for time in (0.001, 0.0123, 0.017000000000000001, 0.03)]


@pytest.mark.parametrize(("name", "time"), [*TIMES, ("sensor_jitter", 0.0123)])
def test_any_time_of_a_slider_is_whole_substeps(name: str, time: float) -> None:
    plant = plant_of(SimulationParameters(), PlaySettings.model_validate({name: time}))
    assert getattr(plant, name) == pytest.approx(time, abs=5e-4)
