"""The command `rabbit`. Each subcommand imports what it needs when it is called."""

import typer

from rabbit_bringup.commands.evaluate import evaluate
from rabbit_bringup.commands.video import video

app = typer.Typer(
    name="rabbit",
    help="RABBIT on stepping stones: simulate, control, learn, evaluate.",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
)
app.command()(evaluate)
app.command()(video)


@app.callback()
def _root() -> None:
    """RABBIT on stepping stones: simulate, control, learn, evaluate."""
