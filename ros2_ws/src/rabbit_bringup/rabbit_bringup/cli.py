"""The command `rabbit`. A subcommand's module is imported when it is called, so that the rest costs nothing."""

import signal
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

COMMANDS = {
    "walk": "Walk through the node graph: simulator, controller, trainer, recorder.",
    "view": "Live view of a running graph, in the browser by Foxglove or in RViz.",
    "run": "Run a package's executable, as `ros2 run` does.",
    "evaluate": "Walk many seeded runs without ROS: success, stones, forces, solver and speed.",
    "reproduce": "Make the paper's figures and tables anew, with its figures beside ours.",
    "gait": "Find a gait: periodic, within the limits of robot and ground, both stone barriers kept.",
    "train": "Learn a policy in process.",
    "policy": "Policy files: show, verify, errors of the estimates, load.",
    "bench": "Time a tick, its parts and a walk against their limits.",
    "jitter": "Walk in real time: late ticks, missed deadlines, the age of the torque, with busy neighbours.",
    "soak": "Walk for an hour with learning, recording and an operator on: does anything grow or fall?",
    "faults": "Kill, stop and mislead the nodes at random ticks of a walk: what must hold, holds?",
    "bag": "Recordings: record, info, play, plot, check, recover.",
    "video": "Film a run, or a recording: MP4 and GIF.",
}


class LazyGroup(TyperGroup):
    """Knows its commands by name and help; `rabbit_bringup.commands.NAME` has the Typer `app` of each."""

    def list_commands(self, ctx: Any) -> list[str]:
        """In the order of the help text."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """What the help text needs of a command."""
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command itself. From here on a Ctrl-C is a `KeyboardInterrupt`, which it may answer."""
        name, _, rest = super().resolve_command(ctx, args)
        command = typer.main.get_command(import_module(f"rabbit_bringup.commands.{name}").app)
        if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return name, command, rest


app = typer.Typer(cls=LazyGroup, add_completion=False, no_args_is_help=True, pretty_exceptions_show_locals=False)


@app.callback()
def _root() -> None:
    """RABBIT on stepping stones: simulate, control, learn, evaluate."""


def main() -> None:
    """The executable `rabbit`; a Ctrl-C while it imports ends it at once."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    app(prog_name="rabbit")
