"""A setting of what the paper does not print: the controller's parameters, the training's, and the plant.

    plant: rigid                                  # on which the claims are judged
    controller: {eps: 0.06, gait: stones_0350_084}
    training: {sigma: 4.0}

It is a YAML file. A value counts where an experiment has none of its own. `settings/` has those that are shipped.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from rabbit_description.bounded_file import FileError
from rabbit_description.validation import one_line
from rabbit_description.yaml_file import read_mapping, yaml_path
from rabbit_experiments.assembly import Assembly
from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
from rl_trainer.parameters import TrainingParameters

from rabbit_reproduce.training_jobs import TrainingJob

SETTINGS = Path(__file__).parent / "settings"
OF_EXPERIMENTS = ("controller", "sigma", "adaptation")  # each experiment says these itself
OF_TRAININGS = ("problem", "seed", "episodes")


class SettingError(ValueError):
    """A file that is no setting: names the file, the value and what was expected."""


class Setting(BaseModel):
    """Changes of `ControllerParameters` and `TrainingParameters`, and the plant of the main column."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    plant: Literal["pybullet", "mujoco", "rigid"] = "pybullet"
    controller: dict[str, Any] = Field(default_factory=dict)
    training: dict[str, Any] = Field(default_factory=dict)

    @field_validator("controller")
    @classmethod
    def _controller(cls, values: dict[str, Any]) -> dict[str, Any]:
        if own := [name for name in OF_EXPERIMENTS if name in values]:
            raise ValueError(f"{own[0]}: each experiment has its own")
        try:
            whole = load_parameters("ours", **values)
        except ParameterError as error:
            raise ValueError(str(error)) from error
        return {name: getattr(whole, name) for name in values}

    @field_validator("training")
    @classmethod
    def _training(cls, values: dict[str, Any]) -> dict[str, Any]:
        if own := [name for name in OF_TRAININGS if name in values]:
            raise ValueError(f"{own[0]}: each training has its own")
        whole = TrainingParameters.model_validate(values)
        return {name: getattr(whole, name) for name in values}

    def own(self, assembly: Assembly) -> Assembly:
        """The same in this setting; what differs from `ours` stays, and so does a plant that is not PyBullet."""
        usual = load_parameters("ours", controller=assembly.controller.controller)
        changes = {
            name: value
            for name, value in self.controller.items()
            if getattr(assembly.controller, name) == getattr(usual, name)
        }
        plant = assembly.simulation
        if plant.plant == "pybullet":
            plant = type(plant).model_validate({**plant.model_dump(), "plant": self.plant})
        whole = {**assembly.controller.model_dump(), **changes}
        return replace(assembly, controller=type(usual).model_validate(whole), simulation=plant)

    def recipe(self, recipe: TrainingJob) -> TrainingJob:
        """The same training in this setting."""
        return replace(
            recipe,
            parameters=recipe.parameters.model_copy(update=self.training),
            tuning=tuple(self.controller.items()),
            engine=self.plant,
        )


OURS = Setting()


def read_setting(name_or_path: str | Path) -> Setting:
    """A shipped setting by its name, or one in a YAML file; raises `SettingError`."""
    path = yaml_path(name_or_path, SETTINGS)
    try:
        return Setting.model_validate(read_mapping(path))
    except (FileError, ValidationError) as error:
        raise SettingError(f"{path}: {one_line(error)}") from error
