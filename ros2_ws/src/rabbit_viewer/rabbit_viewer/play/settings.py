"""What a person can choose while RABBIT walks: a few of the plant's and controller's parameters, within bounds.

The parameters of the command line are beneath them: `plant_of(base, settings)` and `controller_of(base, name)` are what
walks. A field's `when` says whether a change acts at once or from the next reset.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

from pydantic import BaseModel, Field, create_model
from rabbit_description.validation import Checked
from rabbit_sim.parameters import SimulationParameters, marked
from rabbit_sim.perturbation import WHOLE_SUBSTEPS
from rabbit_sim.plant import SUBSTEP_SECONDS
from rl_cbf_clf_controller import kinds
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters

NOBODY, YOURS = "none", "yours"
LEARNED_ROWS: dict[str, Any] = {"controller": "rl-cbf-clf-qp", "adaptation": "none"}
IDENTIFIED = {**LEARNED_ROWS, "adaptation": "identification", "objective": "pd_centred", "gait": "paper_stones"}
SHIPPED = "rl-cbf-clf-qp"  # policy
CONTROLLERS: dict[str, tuple[dict[str, Any], str]] = {  # changed parameters, policy
    "nominal": (LEARNED_ROWS, "zero"),
    "learned": (LEARNED_ROWS, SHIPPED),
    "oracle": (LEARNED_ROWS, "oracle"),
    "identified": (IDENTIFIED, "zero"),
    "best": ({}, "zero"),  # as the file says, see `FILES`
    "tuned": ({}, "zero"),
    "l1": ({"controller": "l1-clf-qp"}, "zero"),
}
FILES = {"best": "best", "tuned": "nominal_tuned"}  # of controller parameters
if TYPE_CHECKING:
    Choice: TypeAlias = str
    OtherChoice: TypeAlias = str
else:  # and every controller that has an entry point
    Choice = Literal["best", "tuned", "learned", "nominal", "identified", "oracle", "l1", YOURS, *kinds.NAMES]
    OtherChoice = Literal[NOBODY, *get_args(Choice)]
SWAPPED_AT_ONCE = {"nominal", "learned", "oracle"}  # the same controller with another policy
ROBOTS = ("first", "second")
NOW: dict[str, Any] = {"when": "now"}
DEFAULTS = {"mass_scale": 0.5, "motor_lag": 0.004}  # where they are not the plant's
SEED = 40  # a course on which the second robot walks some stones, and then falls
Number = Annotated[float, Field(allow_inf_nan=False)]


def shown(
    default: Any, low: float, high: float, title: str, step: float = 1, unit: str = "", when: str = "now", **group: Any
) -> Any:
    """A field's bounds, and what the page shows; `when`: a change acts now or at a reset."""
    extra: dict[str, Any] = {"when": when, "step": step, **({"unit": unit} if unit else {}), **group}
    return Field(default, ge=low, le=high, title=title, json_schema_extra=extra)


def of_the_plant() -> dict[str, Any]:
    """Type and field of those of the plant's parameters that have a `rabbit_sim.perturbation.Control`."""
    plant_fields = {}
    for name, schema in SimulationParameters.model_json_schema()["properties"].items():
        if control := schema.get("control"):
            low, high = (
                schema.get(limit) if control[end] is None else control[end]
                for end, limit in (("low", "minimum"), ("high", "maximum"))
            )
            about = (control["title"], control["step"], control["unit"], "reset" if control["at_reset"] else "now")
            group: dict[str, Any] = {} if control["first"] else {"group": "laboratory"}
            kind = SimulationParameters.model_fields[name].annotation
            default = DEFAULTS.get(name, schema["default"])
            plant_fields[name] = (Number if kind is float else kind, shown(default, low, high, *about, **group))
    return plant_fields


if TYPE_CHECKING:
    OfThePlant = Any  # the fields of `of_the_plant`
else:
    OfThePlant = create_model("OfThePlant", __base__=Checked, **of_the_plant())


class PlaySettings(OfThePlant):
    """Flat; `title`, unit and step are for the page."""

    first: Choice = Field("best", title="controller", json_schema_extra=NOW)
    second: OtherChoice = Field("tuned", title="on the same course", json_schema_extra=NOW)
    motor_power: Number = shown(1.0, 0.3, 1, "motor power", 0.05)
    l_min_std: Number = shown(0.02, 0, 0.08, "stone spread", 0.005, "m", "reset")
    stone_width: Number = shown(0.05, 0.01, 0.3, "stone width", 0.005, "m", "reset")
    stones: int = shown(20, 1, 200, "stones", when="reset")
    seed: int = shown(SEED, 0, 2**31 - 1, "course", when="reset")
    again: Literal["wait", "same course", "next course"] = Field("wait", title="at the end", json_schema_extra=NOW)


PLANT_AT_ONCE = tuple(  # the other settings of the plant are its course, drawn at a reset
    name
    for name, schema in PlaySettings.model_json_schema()["properties"].items()
    if schema["when"] == "now" and name not in (*ROBOTS, "again")
)


class PlayError(ValueError):
    """What is given cannot walk."""


class Yours(BaseModel):
    """Your own controller and policy, as `rabbit evaluate` has them; `name`: what the page calls it."""

    name: str
    controller: ControllerParameters
    policy: str


class Start(BaseModel):
    """What is played: the settings, and the parameters beneath them; `options` as they were typed.

    `yours`: what the robot of that name has.
    """

    settings: PlaySettings
    plant: SimulationParameters
    controller: ControllerParameters
    yours: Yours | None = None
    learns: bool = False
    options: str = ""

    def check(self, settings: PlaySettings) -> None:
        """Raise `PlayError` where a robot is chosen that this command was not given."""
        for title, name in (("controller", settings.first), ("on the same course", settings.second)):
            if name == YOURS and not self.yours:
                raise PlayError(f"{title} yours: expected --controller, --policy or --parameters on the command line")


SHARED = SimulationParameters.model_fields.keys() & PlaySettings.model_fields.keys()


def plant_of(base: SimulationParameters, settings: PlaySettings) -> SimulationParameters:
    """The plant that walks; raises `ValidationError`."""
    changes = {name: getattr(settings, name) for name in SHARED}
    for name in SHARED.intersection(marked(WHOLE_SUBSTEPS)):
        changes[name] = round(changes[name] / SUBSTEP_SECONDS) * SUBSTEP_SECONDS
    changes["motor_loss"] = 1 - settings.motor_power
    return SimulationParameters.model_validate({**base.model_dump(), **changes})


def settings_of(base: SimulationParameters, **others: Any) -> PlaySettings:
    """The settings that a plant amounts to; raises `ValidationError` where it is beyond what can be played with."""
    plant = {name: getattr(base, name) for name in SHARED}
    return PlaySettings.model_validate({**plant, "motor_power": 1 - base.motor_loss, **others})


def controller_of(
    base: ControllerParameters, name: str, terrain: str | None = None
) -> tuple[ControllerParameters, str | None]:
    """Parameters and policy of one of `CONTROLLERS`, or of an entry point's controller; None: the policy it ships."""
    changes, policy = CONTROLLERS.get(name, ({"controller": name, "adaptation": "none"}, None))
    if name in FILES:  # what is given on the command line goes before the file
        return load_parameters(FILES[name], terrain, **base.model_dump(exclude_defaults=True)), policy
    return ControllerParameters.model_validate({**base.model_dump(), **changes}), policy


def controls(start: "Start | None" = None) -> list[dict[str, Any]]:
    """What the page shows of the settings, the robots first, see `described`."""
    entries, has_yours = described(PlaySettings), bool(start and start.yours)
    for control in entries:
        if control["name"] in ROBOTS:
            control["enum"] = [choice for choice in control["enum"] if choice != YOURS or has_yours]
    return sorted(entries, key=lambda control: control["name"] not in ROBOTS)


def described(settings: type[BaseModel]) -> list[dict[str, Any]]:
    """Name, title, choices or bounds, step and unit of the settings, and when they act."""
    shown = ("title", "enum", "minimum", "maximum", "step", "unit", "when", "group", "type", "default")
    fields = settings.model_json_schema()["properties"].items()
    return [{"name": name, **{key: schema[key] for key in shown if key in schema}} for name, schema in fields]
