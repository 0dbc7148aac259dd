"""What a person can choose while RABBIT walks: a few of the plant's and controller's parameters, within bounds.

The parameters of the command line are beneath them: `plant_of(base, settings)` and `controller_of(base, name)` are what
walks. A field's `when` says whether a change acts at once or from the next reset.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from rabbit_common.options import fault
from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters

Choice = Literal["nominal", "learned", "identified", "best", "oracle", "l1"]
OtherChoice = Literal["none", "nominal", "learned", "identified", "best", "oracle", "l1"]
NOBODY = "none"
LEARNED_ROWS: dict[str, Any] = {"controller": "rl-cbf-clf-qp", "adaptation": "none"}
IDENTIFIED = {**LEARNED_ROWS, "adaptation": "identification", "objective": "pd_centred", "gait": "paper_stones"}
SHIPPED = "rl-cbf-clf-qp"  # policy
CONTROLLERS: dict[str, tuple[dict[str, Any], str]] = {  # changed parameters, policy
    "nominal": (LEARNED_ROWS, "zero"),
    "learned": (LEARNED_ROWS, SHIPPED),
    "oracle": (LEARNED_ROWS, "oracle"),
    "identified": (IDENTIFIED, "zero"),
    "best": ({}, "zero"),  # and what the file `best` says
    "l1": ({"controller": "l1-clf-qp"}, "zero"),
}
SWAPPED_AT_ONCE = {"nominal", "learned", "oracle"}  # the same controller with another policy
ROBOTS = ("first", "second")
MOST_DEEDS = 50  # pushes of a walk, and as many changes
NOW: dict[str, Any] = {"when": "now"}
NEXT: dict[str, Any] = {"when": "reset"}
LAB: dict[str, Any] = {**NOW, "group": "laboratory"}
LAB_NEXT = {**LAB, **NEXT}
Number = Annotated[float, Field(allow_inf_nan=False)]


class Checked(BaseModel):
    """Exactly these fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def shown(default: float, low: float, high: float, step: float, title: str, unit: str = "", **how: str) -> Any:
    """A number's bounds, and what the page shows; `how`: when it acts, at once unless it says so, and its group."""
    extra = {**(how or NOW), "step": step, **({"unit": unit} if unit else {})}
    return Field(default, ge=low, le=high, title=title, json_schema_extra=extra)


class PlaySettings(Checked):
    """Flat; `title`, unit and step are for the page."""

    first: Choice = Field("learned", title="controller", json_schema_extra=NOW)
    second: OtherChoice = Field("nominal", title="on the same course", json_schema_extra=NOW)
    mass_scale: Number = shown(2.0, 0.5, 3, 0.05, "mass scale")
    payload: Number = shown(0.0, 0, 80, 1, "payload", "kg")
    ground_friction: Number = shown(1.5, 0.2, 2, 0.05, "friction")
    motor_power: Number = shown(1.0, 0.3, 1, 0.05, "motor power")
    motor_lag: Number = shown(0.004, 0, 0.05, 0.001, "motor lag", "s")
    torque_delay: Number = shown(0.0, 0, 0.03, 0.001, "delay", "s")
    velocity_noise: Number = shown(0.0, 0, 2, 0.05, "noise", "rad/s")
    sensors: Literal["exact", "lab"] = Field("exact", title="sensors", json_schema_extra=LAB_NEXT)
    l_min_std: Number = shown(0.02, 0, 0.08, 0.005, "stone spread", "m", **NEXT)
    stone_width: Number = shown(0.05, 0.01, 0.3, 0.005, "stone width", "m", **NEXT)
    stones: int = Field(20, ge=1, le=200, title="stones", json_schema_extra=NEXT)
    seed: int = Field(1, ge=0, le=2**31 - 1, title="course", json_schema_extra=NEXT)
    again: Literal["wait", "same course", "next course"] = Field("wait", title="at the end", json_schema_extra=NOW)

    ground_stiffness: Number = shown(1e6, 1e4, 1e6, 1e4, "ground stiffness", "N/m", **LAB)
    ground_damping: Number = shown(3e4, 0, 3e4, 500, "ground damping", "N s/m", **LAB)
    slope: Number = shown(0.0, -20, 20, 0.5, "slope", "degrees", **LAB)
    stone_height: Number = shown(0.0, 0, 0.2, 0.005, "stone height", "m", **LAB_NEXT)
    loose_stone: int = Field(0, ge=0, le=200, title="stone that gives way, 0: none", json_schema_extra=LAB_NEXT)
    loose_depth: Number = shown(0.02, 0.001, 0.2, 0.001, "by", "m", **LAB_NEXT)
    push: Number = shown(0.0, 0, 100, 1, "pushes in turn", "N s", **LAB_NEXT)
    push_interval: Number = shown(1.5, 0.1, 60, 0.1, "a push each", "s", **LAB_NEXT)
    payload_ahead: Number = shown(0.0, -0.5, 0.5, 0.01, "payload ahead", "m", **LAB)
    swing_payload: Number = shown(0.0, 0, 100, 1, "swinging payload", "kg", **LAB)
    left_leg_scale: Number = shown(1.0, 0.5, 2, 0.05, "left leg", **LAB)
    left_hip_gain: Number = shown(1.0, 0.1, 2, 0.05, "left hip's motor", **LAB)
    left_knee_gain: Number = shown(1.0, 0.1, 2, 0.05, "left knee's motor", **LAB)
    right_hip_gain: Number = shown(1.0, 0.1, 2, 0.05, "right hip's motor", **LAB)
    right_knee_gain: Number = shown(1.0, 0.1, 2, 0.05, "right knee's motor", **LAB)
    torque_rate: Number = shown(0.0, 0, 1e6, 1000, "torque rate, 0: any", "N m/s", **LAB)
    coulomb: Number = shown(0.0, 0, 100, 0.5, "dry friction", "N m", **LAB)
    knee_spring: Number = shown(0.0, 0, 200, 10, "knees' springs", "N m/rad", **LAB)
    gear_stiffness: Number = shown(0.0, 0, 2e4, 100, "gear stiffness, 0: rigid", "N m/rad", **LAB)
    backlash: Number = shown(0.0, 0, 5, 0.1, "backlash", "degrees", **LAB)


PLANT_AT_ONCE = tuple(  # the other settings of the plant are its course, drawn at a reset
    name
    for name, schema in PlaySettings.model_json_schema()["properties"].items()
    if schema["when"] == "now" and name not in (*ROBOTS, "again")
)


class Push(Checked):
    """On the torso from tick `tick` on."""

    tick: int = Field(ge=0, le=1_000_000)
    force: Number = Field(ge=-1000, le=1000)  # N
    seconds: Number = Field(ge=0.001, le=1)


class Change(Checked):
    """A setting that has another value from tick `tick` on."""

    tick: int = Field(ge=0, le=1_000_000)
    name: Literal[*ROBOTS, *PLANT_AT_ONCE]  # type: ignore[valid-type]
    value: float | str

    @field_validator("value")
    @classmethod
    def _is_one_of_its_setting(cls, value: float | str, info: ValidationInfo) -> Any:
        if "name" not in info.data:
            return value
        name = info.data["name"]
        try:
            return getattr(PlaySettings.model_validate({name: value}), name)
        except ValidationError as error:
            raise ValueError(fault(error)) from error


class Script(Checked):
    """All that makes a played walk: the settings at its start, and what is done at which tick."""

    settings: PlaySettings
    pushes: tuple[Push, ...] = Field((), max_length=MOST_DEEDS)
    changes: tuple[Change, ...] = Field((), max_length=MOST_DEEDS)

    def changed_at(self, tick: int) -> dict[str, Any]:
        """What changes at a tick, by name."""
        return {change.name: change.value for change in self.changes if change.tick == tick}

    def with_changes(self, tick: int, values: Mapping[str, Any]) -> "Script":
        """The same, and `values` from `tick` on; raises `ValidationError` where these are too many."""
        kept = [change for change in self.changes if change.tick != tick or change.name not in values]
        new = [Change(tick=tick, name=name, value=value) for name, value in values.items()]
        return Script(settings=self.settings, pushes=self.pushes, changes=(*kept, *new))

    def with_push(self, push: Push) -> "Script":
        """The same, and a push; raises `ValidationError` where these are too many."""
        return Script(settings=self.settings, pushes=(*self.pushes, push), changes=self.changes)


class PlayError(ValueError):
    """What is given cannot walk."""


class Start(BaseModel):
    """What is played: the settings, and the parameters beneath them; `options` as they were typed."""

    settings: PlaySettings
    plant: SimulationParameters
    controller: ControllerParameters
    learns: bool = False
    options: str = ""


def plant_of(base: SimulationParameters, settings: PlaySettings) -> SimulationParameters:
    """The plant that walks; raises `ValidationError`."""
    delay = round(settings.torque_delay / SUBSTEP_SECONDS) * SUBSTEP_SECONDS
    shared = SimulationParameters.model_fields.keys() & PlaySettings.model_fields.keys()
    changes = {name: getattr(settings, name) for name in shared}
    changes |= {"motor_loss": 1 - settings.motor_power, "torque_delay": delay}
    return SimulationParameters.model_validate({**base.model_dump(), **changes})


def settings_of(base: SimulationParameters, **others: Any) -> PlaySettings:
    """The settings that a plant amounts to; raises `ValidationError` where it is beyond what can be played with."""
    shared = SimulationParameters.model_fields.keys() & PlaySettings.model_fields.keys()
    plant = {name: getattr(base, name) for name in shared}
    return PlaySettings.model_validate({**plant, "motor_power": 1 - base.motor_loss, **others})


def controller_of(base: ControllerParameters, name: str) -> tuple[ControllerParameters, str]:
    """Parameters and policy of one of `CONTROLLERS`."""
    changes, policy = CONTROLLERS[name]
    if name == "best":
        changes = load_parameters("best").model_dump(exclude_defaults=True)
    return ControllerParameters.model_validate({**base.model_dump(), **changes}), policy


def controls() -> list[dict[str, Any]]:
    """What the page shows of each setting: name, title, choices or bounds, step, unit, when it acts."""
    fields = PlaySettings.model_json_schema()["properties"]
    shown = ("title", "enum", "minimum", "maximum", "step", "unit", "when", "group", "type", "default")
    return [{"name": name, **{key: schema[key] for key in shown if key in schema}} for name, schema in fields.items()]
