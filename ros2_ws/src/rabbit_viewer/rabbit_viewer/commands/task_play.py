"""`rabbit play --task TASK`: two controllers of a control task side by side in the browser."""

from functools import partial
from typing import Annotated

import typer
from rabbit_common.options import complaints
from rabbit_experiments.commands.task import Controllers, Seed, Task, chosen

from rabbit_viewer.page import PORT


def play(
    task: Task,
    controller: Controllers = "nominal,oracle",
    seed: Seed = 1,
    port: Annotated[int, typer.Option(help="port of the page; 0: any free one", min=0, max=65535)] = PORT,
    browser: Annotated[bool, typer.Option(help="open the page in a browser")] = True,
) -> None:
    """Watch two controllers ride side by side in the browser, and change the true system as they do."""
    loaded, names = chosen(task, controller)
    from rabbit_viewer.page import PageError
    from rabbit_viewer.play import playing
    from rabbit_viewer.play.serving import serve
    from rabbit_viewer.play.settings import PlayError
    from rabbit_viewer.play.task_player import Start, TaskPlayer, check_asked, settings_of

    with complaints(PageError, PlayError):
        start = Start(task, tuple(names), seed)
        passes = partial(check_asked, settings_of(loaded, start))
        serve(passes, partial(playing.play, TaskPlayer), start, port, browser)
