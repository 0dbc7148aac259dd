"""`rabbit video`: pictures and film of a run that left its records."""

from pathlib import Path
from typing import Annotated

import typer

from rabbit_bringup.commands.options import complaints

app = typer.Typer(add_completion=False)


@app.command()
def video(
    folder: Annotated[Path, typer.Argument(help="folder of a run, with records.npz in it")],
    speed: Annotated[float, typer.Option(help="times real time", min=0.02, max=20)] = 1.0,
    gif: Annotated[bool, typer.Option(help="also a GIF")] = True,
    pictures: Annotated[bool, typer.Option(help="also draw the pictures again")] = False,
) -> None:
    """Film a run: walk.mp4 and walk.gif in its folder."""
    from rabbit_bringup.viewing.pictures import draw_run
    from rabbit_bringup.viewing.video import VideoError, film_run
    from rabbit_bringup.viewing.walk_records import RecordsError

    with complaints(RecordsError, VideoError):
        made = film_run(folder, gif, speed) + (draw_run(folder) if pictures else [])
    for path in made:
        print(path)
