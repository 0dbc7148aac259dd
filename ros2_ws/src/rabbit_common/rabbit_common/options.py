"""Command-line options made from pydantic models: one a field, checked by the model itself.

    @app.command()
    @options(EvaluationOptions, SimulationParameters)
    def evaluate(given: Given) -> None:
        request = given.build(EvaluationOptions)

A field of several models is one option. Values reach the models as text; a wrong one ends the command with one line and
exit code 2. `--help` shows the first model's options and, of the others, those in `USUAL`; `--help-all` shows all.
"""

import functools
import inspect
import re
import shlex
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NoReturn, TypeVar, Union, get_args, get_origin

import typer
from pydantic import BaseModel, Field, ValidationError
from pydantic.fields import FieldInfo
from rabbit_description import validation
from rabbit_description.validation import one_line

from rabbit_common.executables import NAMESPACE
from rabbit_common.exit_codes import of_interrupt

BAD_VALUE = 2
LONGEST_LINE = 1500  # characters of an error
CHOOSES = {"controller", "parameters"}  # options that say themselves which controller
USUAL = {  # what most people set of plant, controller and learner
    *("controller", "gait", "eps", "objective", "adaptation", "sigma", "problem", "learner", "seed", "episodes"),
    *("plant", "terrain", "stones", "mass_scale", "payload", "motor_lag", "ground_friction", "slope", "push"),
    "sensors",
}
Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class Defaults:
    """Defaults of a command by field name. They replace the models' own; `options` shows them in the help text.

    `always` hold where an option is not given, those of `bare` only if neither --controller nor --parameters is given.
    """

    always: Mapping[str, Any] = field(default_factory=dict)
    bare: Mapping[str, Any] = field(default_factory=dict)

    def beneath(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """What is given, with the defaults that hold beside it."""
        return {**self.always, **({} if given.keys() & CHOOSES else self.bare), **given}

    def text(self, name: str, default: Any) -> str:
        """The default of an option, as its help text says it; empty where there is none to name."""
        default = self.always.get(name, default)
        is_none = default is None or default in ("", ())
        if name not in self.bare:
            return "" if is_none else f"(default: {in_words(default)})"
        beside = "" if is_none or name in CHOOSES else f"; {in_words(default)} with --controller or --parameters"
        return f"(default: {in_words(self.bare[name])}{beside})"


@dataclass(frozen=True)
class Given:
    """The options that were given, by field name, over the command's defaults."""

    values: Mapping[str, Any]
    defaults: Defaults = Defaults()

    def of(self, model: type[BaseModel], but: Collection[str] = ()) -> dict[str, Any]:
        """The options of `model`, without those in `but`."""
        values = self.defaults.beneath(self.values)
        chosen = {name: info for name, info in model.model_fields.items() if name in values and name not in but}
        return {name: _split(info, values[name]) for name, info in chosen.items()}

    def typed(self, but: Collection[str]) -> str:
        """The options that were given, `but` some, as one types them."""
        words = []
        for name, value in sorted(self.values.items()):
            if name not in but:
                option = option_name(f"no_{name}" if value is False else name)
                words += [option] if isinstance(value, bool) else [option, str(value)]
        return shlex.join(words)

    def over(self, values: Mapping[str, Any]) -> "Given":
        """The same, and `values` for what was not given."""
        return Given({**values, **self.values}, self.defaults)

    def build(self, model: type[Model], **defaults: Any) -> Model:
        """The model, `defaults` in place of the model's; ends the command where a value is wrong."""
        with complaints():
            return model.model_validate({**defaults, **self.of(model)})


def fail(text: object, code: int = BAD_VALUE) -> NoReturn:
    """End the command with one line of bounded length."""
    print("rabbit:", one_line(text, LONGEST_LINE), file=sys.stderr)
    raise typer.Exit(code)


def is_bare(context: typer.Context) -> bool:
    """Whether a command was called without any argument or option."""
    sources = map(context.get_parameter_source, context.params)
    return all(source is None or source.name == "DEFAULT" for source in sources)


def tell_if_bare(context: typer.Context, about: str, *begin: str) -> None:
    """End a bare call of what takes long: `about` says what it does and how long that takes, `begin` how to begin."""
    if is_bare(context):
        print(about, *(f"    {line}" for line in begin), sep="\n")
        raise typer.Exit


@contextmanager
def complaints(*errors: type[Exception]) -> Iterator[None]:
    """Turn pydantic's errors and `errors` into one line and exit code 2, or the error's own `code`."""
    try:
        yield
    except ValidationError as error:
        fail(fault(error))
    except errors as error:
        fail(error, getattr(error, "code", BAD_VALUE))


@contextmanager
def going_on_from(done: str) -> Iterator[None]:
    """Where a signal ends the command, say from what the same one goes on."""
    try:
        yield
    except KeyboardInterrupt as stop:
        fail(f"stopped; the same command goes on from {done}", code=of_interrupt(stop))


class Graph(BaseModel, defer_build=True):
    """Which running graph a command means."""

    namespace: str = Field("", pattern=NAMESPACE, description="namespace of the graph")


def check_namespace(namespace: str) -> None:
    """End the command where it is none."""
    with complaints():
        Graph(namespace=namespace)


def fault(error: ValidationError) -> str:
    """The first thing that is wrong, as an option."""
    return validation.fault(error, option_name, " ")


def option_name(field: str) -> str:
    """`mass_scale` on the command line."""
    return "--" + field.replace("_", "-")


def options(
    *models: type[BaseModel], without: Collection[str] = (), defaults: Defaults = Defaults(), rare: Collection[str] = ()
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command the fields of `models` as options, `without` some; it is called with what was given.

    The function's parameters after `given` stay as they are. `rare`: those of the first model that `--help` leaves out.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        further = list(inspect.signature(function).parameters.values())[1:]
        kinds = _annotations(models, defaults, rare)
        parameters = further + [_keyword(name, kind) for name, kind in kinds.items() if name not in without]
        parameters += [HELP_ALL] if len(models) > 1 else []

        @functools.wraps(function)
        def command(**values: Any) -> Any:
            kept = {parameter.name: values.pop(parameter.name) for parameter in further}
            values.pop(HELP_ALL.name, None)
            given = {name: value for name, value in values.items() if value is not None}
            return function(Given(given, defaults), **kept)

        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return command

    return decorate


def described(models: Collection[type[BaseModel]], defaults: Defaults = Defaults()) -> dict[str, str]:
    """What each field of `models` is, with its unit and default."""
    return {name: _help(name, info, defaults) for model in models for name, info in model.model_fields.items()}


def _show_all(context: typer.Context, given: bool) -> None:
    """Print the help text with the options that it leaves out otherwise."""
    if given:
        for parameter in context.command.params:
            parameter.hidden = False  # type: ignore[attr-defined]
        print(context.get_help())
        raise typer.Exit


def _keyword(name: str, kind: Any, default: Any = None) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


HELP_ALL = _keyword(
    "help_all",
    Annotated[bool, typer.Option("--help-all", is_eager=True, callback=_show_all, help="Show all options and exit.")],
    default=False,
)


def _annotations(models: tuple[type[BaseModel], ...], defaults: Defaults, rare: Collection[str]) -> dict[str, Any]:
    kinds: dict[str, Any] = {}
    for model in models:
        panel = re.findall(r"[A-Z][a-z]*|$", model.__name__)[0]
        for name, info in model.model_fields.items():
            flag, is_rare = option_name(name), name in rare if model is models[0] else name not in USUAL
            shown: Any = {"help": _help(name, info, defaults), "rich_help_panel": panel, "hidden": is_rare}
            kind: Any = Annotated[str | None, typer.Option(flag, metavar=_metavar(info.annotation), **shown)]
            if info.annotation is bool:
                kind = Annotated[bool | None, typer.Option(f"{flag}/--no-{flag[2:]}", **shown)]
            kinds.setdefault(name, kind)
    return kinds


def _help(name: str, info: FieldInfo, defaults: Defaults) -> str:
    default = None if info.is_required() or info.default_factory else info.default
    return f"{info.description or ''} {defaults.text(name, default)}".strip()


def _split(info: FieldInfo, value: Any) -> Any:
    """The parts of a list, where the field is one."""
    is_list = get_origin(info.annotation) is tuple
    return [part for part in value.split(",") if part] if is_list and isinstance(value, str) else value


def in_words(default: Any) -> str:
    """A default as a help text has it, and as one types it."""
    if isinstance(default, bool):
        return "on" if default else "off"
    return ",".join(map(str, default)) if isinstance(default, list | tuple) else str(default)


def in_one_form(command: Any) -> Any:
    """The command, whose options, where typer made them, show values and defaults as `options` does."""
    for subcommand in getattr(command, "commands", {}).values():
        in_one_form(subcommand)
    for option in command.params:
        is_flag = getattr(option, "is_flag", False)
        if option.show_default and option.default not in (None, "", []) and not (is_flag and not option.secondary_opts):
            option.help = f"{option.help or ''} (default: {in_words(option.default)})".strip()
        option.show_default = False
        kind = getattr(option, "type_descriptor", None)
        if kind and option.param_type_name == "option" and not is_flag and not option.metavar:
            option.metavar = _metavar(kind.annotation)
    return command


def _metavar(annotation: Any) -> str:
    if get_origin(annotation) is Literal:
        return "|".join(map(str, get_args(annotation)))
    if get_origin(annotation) in (tuple, list):
        return f"{_metavar(get_args(annotation)[0])},..."
    if get_origin(annotation) in (UnionType, Union, Annotated):  # with None, or with a check
        return _metavar(get_args(annotation)[0])
    return {float: "NUMBER", int: "COUNT", str: "NAME", Path: "PATH"}.get(annotation, "VALUE")
