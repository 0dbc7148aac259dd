"""The methods of the benchmark, and those that packages bring.

entry_points={"rabbit.methods": ["mine = my_package.method:MINE"]}      in a setup.py; MINE is a `Method`
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from rabbit_description import plugins
from rabbit_description.validation import one_of
from rabbit_reproduce.controllers import (
    AT_ITS_BEST,
    BEST,
    GAIT,
    IDENTIFIED,
    INTEGRAL,
    LIBRARY,
    LOW_TORQUE,
    MARGIN,
    PD,
    PREDICTED,
    SLOPES,
    Contender,
    variant,
)
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_benchmark.cells import Map, Terrain

GROUP = "rabbit.methods"
REFERENCE = "identified"  # with which the others are compared
LIKE: dict[Map, Map] = {  # no method has parameters of its own on these
    "storm-2": "storm",
    **dict.fromkeys(("reported", "unseen", "unseen-2", "contact"), "development"),
}


class MethodError(ValueError):
    """No such method, or what an entry point brings is none."""


@dataclass(frozen=True)
class Method:
    """A name, a title for tables, what it was trained on, and a controller with parameters and policy by terrain.

    It has no controller on a terrain that it cannot walk, and `trained_on` is empty where nothing was learned. `tuned`:
    its parameters on a map and terrain alone; a map that is only reported has those of the map that it is `LIKE`.
    """

    name: str
    title: str
    stones: Contender | None = None
    flat: Contender | None = None
    trained_on: str = ""
    tuned: Mapping[tuple[Map, Terrain], dict[str, Any]] = field(default_factory=dict, hash=False)

    def on(self, terrain: Terrain, where: Map | None = None) -> Contender | None:
        """The method's controller there."""
        contender = self.stones if terrain == "stones" else self.flat
        tuning = self.tuned.get((LIKE.get(where, where), terrain), {}) if where else {}
        return contender and _with(contender, tuning)


PAPER_POLICY = "DDPG at mass scale 2, no motor lag, seed 1: 6,572 transitions on stones, 7,981 on flat ground"
SPEED_MODEL = "its model of the speed: walks of random plants with random changes of the slope (rabbit speed)"
FAMILIES = (
    f"{SPEED_MODEL}; what it does about slow motors and loose stones, eps: development families;"
    " when it gives way, its gait on flat ground: development seeds of all families"
)
ORACLE = "knows the true plant: the bound, not a method"
PI_ON_SLOPES = {**SLOPES, **INTEGRAL}
PI_OF_LOW_TORQUE = {**LOW_TORQUE, **INTEGRAL}
TUNED: dict[tuple[Map, Terrain], dict[str, Any]] = {  # on development seeds of each map (studies/docs/tuning.md)
    ("outside", "stones"): PI_ON_SLOPES | {"eps": 0.03},
    ("outside", "flat"): PI_OF_LOW_TORQUE | {"eps": 0.03},
    ("storm", "stones"): PI_ON_SLOPES | {"eps": 0.02},
    ("storm", "flat"): PI_ON_SLOPES | {"eps": 0.04},
    ("development", "stones"): PI_ON_SLOPES | {"eps": 0.03},
    ("development", "flat"): PI_OF_LOW_TORQUE | {"eps": 0.04},
}


def _method(name: str, title: str, policy: str, *tuning: dict[str, str], trained_on: str = "") -> Method:
    """One that walks on both terrains, with a gait library and a margin on stones, and with a gait on flat ground."""
    kinds = ("cbf-clf-qp", "clf-qp") if name.startswith("nominal") else ("rl-cbf-clf-qp", "rl-clf-qp")
    stones = variant(title, kinds[0], policy, LIBRARY, MARGIN, *tuning)
    return Method(name, title, stones, variant(title, kinds[1], policy, GAIT, *tuning), trained_on)


def _on_slopes(name: str, title: str, policy: str, *tuning: dict[str, Any], trained_on: str = "") -> Method:
    """One that regulates its speed by gaits for slopes, on both terrains; PD-centred."""
    stones = variant(title, "rl-cbf-clf-qp", policy, SLOPES, PD, *tuning)
    return Method(name, title, stones, variant(title, "rl-clf-qp", policy, LOW_TORQUE, PD, *tuning), trained_on)


def _with(contender: Contender, tuning: dict[str, Any]) -> Contender:
    """The same with these parameters too."""
    return replace(contender, tuning=contender.tuning + tuple(tuning.items()))


def _paper(name: str, title: str, *tuning: dict[str, Any]) -> Method:
    """The shipped policies, on the gait that they were trained on."""
    stones, flat = (variant(title, kind, kind, *tuning) for kind in ("rl-cbf-clf-qp", "rl-clf-qp"))
    return Method(name, title, stones, flat, PAPER_POLICY)


BUILT_IN = (
    _method("nominal", "nominal, mu'mu", "zero"),
    _method("nominal-pd", "nominal, PD-centred", "zero", PD),
    Method("nominal-tuned", "nominal at its best", AT_ITS_BEST["stones"], AT_ITS_BEST["flat"], tuned=TUNED),
    Method("robust", "robust, mu'mu", stones=variant("robust", "robust-cbf-clf-qp", "zero", LIBRARY, MARGIN)),
    Method("l1", "L1, mu'mu", flat=variant("L1", "l1-clf-qp", "zero", GAIT)),
    _method(REFERENCE, "identified, PD-centred", "zero", IDENTIFIED, PD),
    _method("identified-mu", "identified, mu'mu", "zero", IDENTIFIED),
    _paper("paper", "the paper's policy"),
    _paper("paper-pd", "the paper's policy, PD-centred", PD),
    Method("best", "best", BEST["stones"], BEST["flat"], FAMILIES),
    _on_slopes("best-before", "best, without care", "zero", IDENTIFIED, PREDICTED, SLOPES, trained_on=SPEED_MODEL),
    Method(
        "best-unlearned",
        "best, speed by PI control",
        _with(BEST["stones"], INTEGRAL),
        _with(BEST["flat"], INTEGRAL),
    ),
    _on_slopes("best-nominal", "best, not identified", "zero", trained_on=SPEED_MODEL),
    _on_slopes("best-neither", "best, neither", "zero", INTEGRAL),
    _method("oracle", "oracle, PD-centred", "oracle", PD, trained_on=ORACLE),
    _method("oracle-mu", "oracle, mu'mu", "oracle", trained_on=ORACLE),
    _on_slopes("oracle-slopes", "oracle, gaits for slopes", "oracle", trained_on=ORACLE),
)


def names() -> list[str]:
    """The names of all methods, the built-in ones first; raises `MethodError` where two are the same."""
    ours = [built_in.name for built_in in BUILT_IN]
    try:
        return [*ours, *(name for name in plugins.names(GROUP) if name not in ours)]
    except LookupError as error:
        raise MethodError(str(error)) from error


def method(name: str) -> Method:
    """The one of this name; raises `MethodError`."""
    for built_in in BUILT_IN:
        if built_in.name == name:
            return built_in
    if name not in names():
        raise MethodError(f"{name}: expected {one_of(name, names())}")
    try:
        entered = plugins.load(GROUP, name)
    except LookupError as error:
        raise MethodError(str(error)) from error
    if not isinstance(entered, Method) or entered.name != name:
        raise MethodError(f"{GROUP} {name}: expected a Method of this name, found {entered!r}")
    return entered


def variants(text: str) -> list[Method]:
    """`NAME`, or `NAME:PARAMETER=VALUE,VALUE:...`: the method with each combination of values of its controller.

    Example: `nominal-pd:eps=0.02,0.03:gait=slopes`. Raises `MethodError`.
    """
    name, *settings = text.split(":")
    choices: list[list[tuple[str, Any]]] = []
    for setting in settings:
        parameter, _, values = setting.partition("=")
        if parameter not in ControllerParameters.model_fields or not values:
            known = one_of(parameter, ControllerParameters.model_fields)
            raise MethodError(
                f"{text}: {setting}: expected PARAMETER=VALUE,..., a parameter of the controller, {known}"
            )
        choices.append([(parameter, _value(value)) for value in values.split(",")])
    return [_tuned(method(name), tuning) for tuning in product(*choices)]


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _tuned(base: Method, tuning: tuple[tuple[str, Any], ...]) -> Method:
    """The method with other parameters on each terrain that it walks."""
    if not tuning:
        return base
    about = [f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in tuning]
    stones, flat = (contender and _with(contender, dict(tuning)) for contender in (base.stones, base.flat))
    tuned = {where: changes | dict(tuning) for where, changes in base.tuned.items()}
    name, title = ":".join([base.name, *about]), ", ".join([base.title, *about])
    return replace(base, name=name, title=title, stones=stones, flat=flat, tuned=tuned)
