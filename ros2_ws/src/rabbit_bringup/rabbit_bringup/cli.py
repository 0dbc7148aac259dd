"""The command `rabbit`. Packages bring its subcommands by entry points of the group `rabbit.commands`.

    "rabbit.commands": ["bag = rabbit_recording.commands.bag:app"]      a Typer app, in a setup.py

The first line of the module's docstring is the help text here. The module is imported when its command is called, so
that the rest costs nothing.
"""

import ast
import errno
import gc
import os
import signal
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, NoReturn

os.environ.setdefault("TYPER_USE_RICH", "0")  # its panels make a help text twice as long, and later

import typer
from rabbit_common.exit_codes import Interrupted, of_interrupt
from rabbit_description.plugins import entries
from typer.core import TyperCommand, TyperGroup

GROUP, OF_TASKS = "rabbit.commands", "rabbit.task_commands"  # those of tasks are functions, not apps
# as the help text lists them; those of other packages follow by name
ORDER = (
    *("play", "walk", "view", "run", "evaluate", "benchmark", "misses", "speed", "reproduce"),
    *("gait", "train", "scales", "policy", "export", "estimates", "estimator", "rival", "residual"),
    *("bench", "jitter", "soak", "bag", "video"),
)
TASK_HELP = "run a control task of your own instead of RABBIT; for its options: --task TASK --help"
# what `pip install` leaves out unless asked: who only walks needs none of it
EXTRAS = {
    "torch": "pip install 'rl_trainer[learn]'; in a checkout make torch",
    "imageio_ffmpeg": "pip install 'rabbit_viewer[film]'",
}


@cache
def commands() -> dict[str, EntryPoint]:
    """The subcommands that the installed packages bring, by name, in the order of the help text."""
    by_name = {entry.name: entry for entry in entries(GROUP)}
    ordered = [name for name in ORDER if name in by_name]
    return {name: by_name[name] for name in ordered + sorted(by_name.keys() - set(ordered))}


def source(command: EntryPoint) -> Path | None:
    """The file of a command's module; None if there is none. Nothing is imported, not even the packages around it."""
    top, *rest = command.module.split(".")
    spec, name = find_spec(top), top
    for part in rest:
        name = f"{name}.{part}"
        spec = PathFinder.find_spec(name, spec.submodule_search_locations) if spec else None
    return Path(spec.origin) if spec and spec.origin else None


def summary(command: EntryPoint) -> str:
    """The first line of the docstring of a command's module."""
    if (path := source(command)) is None:
        return f"(cannot be called: there is no module {command.module})"
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def loaded(command: EntryPoint) -> Any:
    """The command itself, whose module is imported."""
    from rabbit_common.options import in_one_form  # which takes a while

    app = command.load()
    if command.group == OF_TASKS:
        shown = typer.Typer(add_completion=False)
        shown.command(command.name)(app)
        return in_one_form(typer.main.get_command(shown))
    click_command = typer.main.get_command(app)
    if command.name in task_commands():
        click_command.params.append(task_option())
    return in_one_form(click_command)


@cache
def task_commands() -> dict[str, EntryPoint]:
    """What commands do with `--task`, by name."""
    return {entry.name: entry for entry in entries(OF_TASKS)}


def chosen(name: str, words: list[str]) -> EntryPoint:
    """What the command `name` runs before these words."""
    has_task = any(word.partition("=")[0] == "--task" for word in words)
    return (task_commands() if has_task and name in task_commands() else commands())[name]


def task_option() -> Any:
    """`--task` for a help text: with it another function runs, see `task_commands`."""
    shown = typer.Typer(add_completion=False)

    @shown.command()
    def _(task: Annotated[str, typer.Option(help=TASK_HELP, metavar="TASK")] = "") -> None: ...

    option = typer.main.get_command(shown).params[0]
    option.expose_value = False
    return option


def _fail(text: str) -> NoReturn:
    from rabbit_common.options import fail  # which takes a while

    fail(text)


def _replace_default(number: int, default: Any, handler: Any) -> None:
    """Answer a signal so, where nobody has it ignored or answers it already."""
    if signal.getsignal(number) is default:
        signal.signal(number, handler)


class LazyGroup(TyperGroup):
    """Knows the commands by name and help, see `commands` and `summary`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The commands in the order of the help text."""
        return list(commands())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """What the help text needs of a command."""
        return TyperCommand(cmd_name, help=summary(commands()[cmd_name])) if cmd_name in commands() else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command itself. From here on a Ctrl-C or SIGTERM is a `KeyboardInterrupt`, which it may answer."""
        if args[0] in ORDER and args[0] not in commands():
            _fail(f"{args[0]} is not installed: call make studies, or pip install rabbit_studies rabbit_qa")
        if args[0] not in commands() and not args[0].startswith("-"):
            from rabbit_description.validation import nearest

            near = nearest(args[0], commands())
            _fail(f"no command {args[0]}{f': did you mean {near}?' if near else '; rabbit --help lists them'}")
        name, _, rest = super().resolve_command(ctx, args)
        entry = chosen(str(name), rest)
        if source(entry) is None:
            _fail(f"{name} cannot be called: there is no module {entry.module}")
        gc.disable()  # of what is imported nothing is garbage; looking for it takes a fifth of the time to a help text
        command = loaded(entry)
        gc.enable()
        _replace_default(signal.SIGINT, signal.SIG_DFL, signal.default_int_handler)
        _replace_default(signal.SIGTERM, signal.SIG_DFL, _terminate)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        """Run the command; a signal that it does not answer ends it with the shell's code.

        What the system refuses, as a full or read-only disk does, ends it with one line; so does what is
        not installed, and an error in a person's own task or plugin, or in what a task's commands give.
        """
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            if error.name not in EXTRAS:
                raise
            _fail(f"{error.name} is not installed: {EXTRAS[error.name]}")
        except OSError as error:
            if error.errno in (None, errno.EPIPE):  # not the system's; a pipe whose reader has gone
                raise
            _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror))
        except KeyboardInterrupt as error:
            ctx.exit(of_interrupt(error))
        except Exception as error:
            from rabbit_description.plugins import PluginError
            from rabbit_description.task import TaskError
            from rabbit_description.user_code import fault_in_user_code

            where = str(error) if isinstance(error, PluginError | TaskError) else fault_in_user_code(error)
            if not where:
                raise
            _fail(where)


def _terminate(number: int, _: object) -> None:
    signal.signal(number, signal.SIG_DFL)  # a second one ends the command at once
    raise Interrupted(number)


app = typer.Typer(cls=LazyGroup, add_completion=False, no_args_is_help=True, pretty_exceptions_show_locals=False)


def _show_version(given: bool) -> None:
    if given:
        print(f"rabbit {version('rabbit_bringup')}")
        raise typer.Exit


@app.callback()
def _root(
    _version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Show the version and exit.")
    ] = False,
) -> None:
    """RABBIT on stepping stones: simulate, control, learn, evaluate."""


def main() -> None:
    """The executable `rabbit`; a Ctrl-C while it imports ends it at once."""
    _replace_default(signal.SIGINT, signal.default_int_handler, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        app(prog_name="rabbit")
    finally:  # all is written: a Ctrl-C while libraries end their processes is no traceback
        _replace_default(signal.SIGINT, signal.default_int_handler, signal.SIG_DFL)
