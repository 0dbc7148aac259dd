"""A walk as a film: MP4, and a small GIF. The encoder is the one that imageio-ffmpeg brings."""

import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer.scene import SIZE, Scene

FRAME_RATE = 25  # 1/s
LAST_FRAME = 0.8  # s, for which the last frame stays
GIF_RATE, GIF_WIDTH = 12.5, 480
PICTURES = ("-f", "rawvideo", "-pix_fmt", "rgba", "-r", str(FRAME_RATE), "-s")  # and the size
MP4 = ("-map", "0:v", "-c:v", "libx264", "-preset", "veryfast", "-crf", "25", "-pix_fmt", "yuv420p")
SMALL = f"[0:v]fps={GIF_RATE},scale={GIF_WIDTH}:-1:flags=area,split[a][b]"
GIF = ("-filter_complex", f"{SMALL};[a]palettegen=max_colors=64[p];[b][p]paletteuse[gif]", "-map", "[gif]")


class VideoError(RuntimeError):
    """The encoder failed."""


def film(walk: WalkRecords, path: Path, speed: float = 1.0, gif: bool = False) -> list[Path]:
    """Write an MP4 of the walk at `speed` times real time, and a GIF of half its frames while that is encoded.

    Raises:
        VideoError: the encoder failed.
    """
    return encode(_frames(walk, speed), SIZE, path, gif)


def encode(frames: Iterable[memoryview], size: tuple[int, int], path: Path, gif: bool = False) -> list[Path]:
    """Write RGBA pictures of `size` (width, height), `FRAME_RATE` a second, as `film` does."""
    import imageio_ffmpeg  # type: ignore[import-untyped]  # pictures do without it

    path.parent.mkdir(parents=True, exist_ok=True)
    made = [path, path.with_suffix(".gif")] if gif else [path]
    words = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *PICTURES, f"{size[0]}x{size[1]}", "-i", "-"]
    words += [*MP4, str(path), *(GIF if gif else ()), *map(str, made[1:])]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        with suppress(BrokenPipeError):  # it has ended, and says why
            for picture in frames:
                encoder.stdin.write(picture)  # type: ignore[union-attr]
        _, complaint = encoder.communicate()
    if encoder.returncode:
        raise VideoError(f"{path}: {complaint.decode(errors='replace').strip()}")
    return made


def _frames(walk: WalkRecords, speed: float) -> Iterator[memoryview]:
    scene, last = Scene(walk), len(walk.tick) - 1
    for row in np.arange(0, last, speed / (FRAME_RATE * TICK_SECONDS)).astype(int).tolist():
        yield scene.frame(row).data
    yield from [scene.frame(last).data] * round(LAST_FRAME * FRAME_RATE)
