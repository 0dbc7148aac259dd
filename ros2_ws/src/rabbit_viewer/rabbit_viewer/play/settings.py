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
SHIPPED = "rl-cbf-clf-qp"  # policy
CONTROLLERS: dict[str, tuple[dict[str, Any], str]] = {  # changed parameters, policy
    "nominal": (LEARNED_ROWS, "zero"),
    "learned": (LEARNED_ROWS, SHIPPED),
    "oracle": (LEARNED_ROWS, "oracle"),
    "identified": (
        {
            "controller": "rl-cbf-clf-qp",
            "adaptation": "identification",
            "objective": "pd_centred",
            "gait": "paper_stones",
        },
        "zero",
    ),
    "best": (load_parameters("best").model_dump(exclude_defaults=True), "zero"),
    "l1": ({"controller": "l1-clf-qp"}, "zero"),
}
SWAPPED_AT_ONCE = {"nominal", "learned", "oracle"}  # the same controller with another policy
ROBOTS = ("first", "second")
PLANT_AT_ONCE = (  # the other settings of the plant are its course, drawn at a reset
    "mass_scale",
    "payload",
    "ground_friction",
    "motor_power",
    "motor_lag",
    "torque_delay",
    "velocity_noise",
    "ground_stiffness",
    "ground_damping",
    "slope",
    "payload_ahead",
    "swing_payload",
    "left_leg_scale",
    "left_hip_gain",
    "left_knee_gain",
    "right_hip_gain",
    "right_knee_gain",
    "torque_rate",
    "coulomb",
    "knee_spring",
    "gear_stiffness",
    "backlash",
)
MOST_DEEDS = 50  # pushes of a walk, and as many changes
NOW: dict[str, Any] = {"when": "now"}
NEXT: dict[str, Any] = {"when": "reset"}
LAB: dict[str, Any] = {**NOW, "group": "laboratory"}
Number = Annotated[float, Field(allow_inf_nan=False)]


class Checked(BaseModel):
    """Exactly these fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class PlaySettings(Checked):
    """Flat; `title`, unit and step are for the page."""

    first: Choice = Field("learned", title="controller", json_schema_extra=NOW)
    second: OtherChoice = Field("nominal", title="on the same course", json_schema_extra=NOW)
    mass_scale: Number = Field(2.0, ge=0.5, le=3, title="mass scale", json_schema_extra={**NOW, "step": 0.05})
    payload: Number = Field(0.0, ge=0, le=80, title="payload", json_schema_extra={**NOW, "step": 1, "unit": "kg"})
    ground_friction: Number = Field(1.5, ge=0.2, le=2, title="friction", json_schema_extra={**NOW, "step": 0.05})
    motor_power: Number = Field(1.0, ge=0.3, le=1, title="motor power", json_schema_extra={**NOW, "step": 0.05})
    motor_lag: Number = Field(
        0.004, ge=0, le=0.05, title="motor lag", json_schema_extra={**NOW, "step": 0.001, "unit": "s"}
    )
    torque_delay: Number = Field(
        0.0, ge=0, le=0.03, title="delay", json_schema_extra={**NOW, "step": 0.001, "unit": "s"}
    )
    velocity_noise: Number = Field(
        0.0, ge=0, le=2, title="noise", json_schema_extra={**NOW, "step": 0.05, "unit": "rad/s"}
    )
    sensors: Literal["exact", "lab"] = Field("exact", title="sensors", json_schema_extra={**LAB, **NEXT})
    l_min_std: Number = Field(
        0.02, ge=0, le=0.08, title="stone spread", json_schema_extra={**NEXT, "step": 0.005, "unit": "m"}
    )
    stone_width: Number = Field(
        0.05, ge=0.01, le=0.3, title="stone width", json_schema_extra={**NEXT, "step": 0.005, "unit": "m"}
    )
    stones: int = Field(20, ge=1, le=200, title="stones", json_schema_extra=NEXT)
    seed: int = Field(1, ge=0, le=2**31 - 1, title="course", json_schema_extra=NEXT)
    again: Literal["wait", "same course", "next course"] = Field("wait", title="at the end", json_schema_extra=NOW)

    ground_stiffness: Number = Field(
        1e6, ge=1e4, le=1e6, title="ground stiffness", json_schema_extra={**LAB, "step": 1e4, "unit": "N/m"}
    )
    ground_damping: Number = Field(
        3e4, ge=0, le=3e4, title="ground damping", json_schema_extra={**LAB, "step": 500, "unit": "N s/m"}
    )
    slope: Number = Field(0.0, ge=-20, le=20, title="slope", json_schema_extra={**LAB, "step": 0.5, "unit": "degrees"})
    stone_height: Number = Field(
        0.0, ge=0, le=0.2, title="stone height", json_schema_extra={**LAB, **NEXT, "step": 0.005, "unit": "m"}
    )
    loose_stone: int = Field(0, ge=0, le=200, title="stone that gives way, 0: none", json_schema_extra={**LAB, **NEXT})
    loose_depth: Number = Field(
        0.02, ge=0.001, le=0.2, title="by", json_schema_extra={**LAB, **NEXT, "step": 0.001, "unit": "m"}
    )
    push: Number = Field(
        0.0, ge=0, le=100, title="pushes in turn", json_schema_extra={**LAB, **NEXT, "step": 1, "unit": "N s"}
    )
    push_interval: Number = Field(
        1.5, ge=0.1, le=60, title="a push each", json_schema_extra={**LAB, **NEXT, "step": 0.1, "unit": "s"}
    )
    payload_ahead: Number = Field(
        0.0, ge=-0.5, le=0.5, title="payload ahead", json_schema_extra={**LAB, "step": 0.01, "unit": "m"}
    )
    swing_payload: Number = Field(
        0.0, ge=0, le=100, title="swinging payload", json_schema_extra={**LAB, "step": 1, "unit": "kg"}
    )
    left_leg_scale: Number = Field(1.0, ge=0.5, le=2, title="left leg", json_schema_extra={**LAB, "step": 0.05})
    left_hip_gain: Number = Field(1.0, ge=0.1, le=2, title="left hip's motor", json_schema_extra={**LAB, "step": 0.05})
    left_knee_gain: Number = Field(
        1.0, ge=0.1, le=2, title="left knee's motor", json_schema_extra={**LAB, "step": 0.05}
    )
    right_hip_gain: Number = Field(
        1.0, ge=0.1, le=2, title="right hip's motor", json_schema_extra={**LAB, "step": 0.05}
    )
    right_knee_gain: Number = Field(
        1.0, ge=0.1, le=2, title="right knee's motor", json_schema_extra={**LAB, "step": 0.05}
    )
    torque_rate: Number = Field(
        0.0, ge=0, le=1e6, title="torque rate, 0: any", json_schema_extra={**LAB, "step": 1000, "unit": "N m/s"}
    )
    coulomb: Number = Field(
        0.0, ge=0, le=100, title="dry friction", json_schema_extra={**LAB, "step": 0.5, "unit": "N m"}
    )
    knee_spring: Number = Field(
        0.0, ge=0, le=200, title="knees' springs", json_schema_extra={**LAB, "step": 10, "unit": "N m/rad"}
    )
    gear_stiffness: Number = Field(
        0.0, ge=0, le=2e4, title="gear stiffness, 0: rigid", json_schema_extra={**LAB, "step": 100, "unit": "N m/rad"}
    )
    backlash: Number = Field(
        0.0, ge=0, le=5, title="backlash", json_schema_extra={**LAB, "step": 0.1, "unit": "degrees"}
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
    return ControllerParameters.model_validate({**base.model_dump(), **changes}), policy


def controls() -> list[dict[str, Any]]:
    """What the page shows of each setting: name, title, choices or bounds, step, unit, when it acts."""
    fields = PlaySettings.model_json_schema()["properties"]
    shown = ("title", "enum", "minimum", "maximum", "step", "unit", "when", "group", "type", "default")
    return [{"name": name, **{key: schema[key] for key in shown if key in schema}} for name, schema in fields.items()]
