"""Film a run, or a recording: MP4 and GIF."""

from pathlib import Path
from typing import Annotated

import typer
from rabbit_common.options import complaints
from rabbit_recording import RecordingError

app = typer.Typer(add_completion=False)


@app.command()
def video(
    source: Annotated[Path, typer.Argument(help="a run's folder, or a recording: folder or .mcap file")],
    beside: Annotated[Path | None, typer.Argument(help="another run or recording, filmed beside the first")] = None,
    speed: Annotated[float, typer.Option(help="times real time", min=0.02, max=20)] = 1.0,
    gif: Annotated[bool, typer.Option(help="also a GIF")] = True,
    episode: Annotated[
        int | None, typer.Option(help="episode of a recording (default: the last with ticks)", min=1)
    ] = None,
) -> None:
    """Film a run, walk.mp4 and walk.gif in its folder, or a recording, BAG.mp4 and BAG.gif beside it; or two."""
    from rabbit_experiments.walk_records import RecordsError

    from rabbit_viewer.video import VideoError
    from rabbit_viewer.walk_pictures import film_walk

    with complaints(RecordsError, RecordingError, VideoError):
        print(*film_walk(source, gif, speed, episode, beside), sep="\n")
