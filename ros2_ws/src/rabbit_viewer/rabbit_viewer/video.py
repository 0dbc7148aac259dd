"""Walks as a film, side by side: MP4, and a small GIF. The encoder is the one that imageio-ffmpeg brings.

Where a robot falls, the film is slow, as the page is; it ends when the last robot has stopped.
"""

import subprocess
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from rabbit_description.tick import ticks_in
from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer.scene import SIZE, Scene

FRAME_RATE = 25  # 1/s
LAST_FRAME = 0.8  # s, for which the last frame stays
GIF_RATE, GIF_WIDTH = 12.5, 560  # of a walk
SLOW, AROUND = 0.25, 0.2  # times real time; s before and after a fall that are slow too
PICTURES = ("-f", "rawvideo", "-pix_fmt", "rgba", "-r", str(FRAME_RATE), "-s")  # and the size
MP4 = ("-map", "0:v", "-c:v", "libx264", "-preset", "veryfast", "-crf", "25", "-pix_fmt", "yuv420p")
SMALL = f"[0:v]fps={GIF_RATE},scale={{width}}:-1:flags=area,split[a][b]"
PALETTE = "[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none:diff_mode=rectangle[gif]"


class VideoError(RuntimeError):
    """The encoder failed."""


def film(walks: Sequence[WalkRecords], path: Path, speed: float = 1.0, gif: bool = False) -> list[Path]:
    """Write an MP4 of the walks at `speed` times real time, and a GIF of half its frames while that is encoded.

    Raises:
        VideoError: the encoder failed.
    """
    size = SIZE[0] * len(walks), SIZE[1]
    return encode(_frames(walks, speed), size, path, gif, GIF_WIDTH * len(walks))


def encode(
    frames: Iterable[memoryview], size: tuple[int, int], path: Path, gif: bool = False, width: int = GIF_WIDTH
) -> list[Path]:
    """Write RGBA pictures of `size` (width, height), `FRAME_RATE` a second, as `film` does; the GIF of this `width`."""
    import imageio_ffmpeg  # type: ignore[import-untyped]  # pictures do without it

    path.parent.mkdir(parents=True, exist_ok=True)
    films = [path, path.with_suffix(".gif")] if gif else [path]
    words = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *PICTURES, f"{size[0]}x{size[1]}", "-i", "-"]
    words += [*MP4, str(path)]
    if gif:
        words += ["-filter_complex", f"{SMALL.format(width=width)};{PALETTE}", "-map", "[gif]", str(films[1])]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        with suppress(BrokenPipeError):  # it has ended, and says why
            for picture in frames:
                encoder.stdin.write(picture)  # type: ignore[union-attr]
        _, complaint = encoder.communicate()
    if encoder.returncode:
        raise VideoError(f"{path}: {complaint.decode(errors='replace').strip()}")
    return films


def _frames(walks: Sequence[WalkRecords], speed: float) -> Iterator[memoryview]:
    scenes = [Scene(walk, has_legend=not i) for i, walk in enumerate(walks)]
    shares = [walks[0].tick_seconds / walk.tick_seconds for walk in walks]  # ticks of the walk in a tick of the first
    films = [(scene, share, len(walk.tick) - 1) for scene, share, walk in zip(scenes, shares, walks, strict=True)]
    falls = [(scene.fall / share, last / share) for scene, share, last in films if scene.fall is not None]
    around, end = ticks_in(AROUND, walks[0].tick_seconds), max(last / share for _, share, last in films)
    row, pace = 0.0, speed / (FRAME_RATE * walks[0].tick_seconds)

    def frame() -> memoryview:
        return np.hstack([scene.frame(min(int(row * share), last)) for scene, share, last in films]).data

    while row < end:
        yield frame()
        row += pace * (SLOW if any(first - around <= row <= last + around for first, last in falls) else 1)
    row = end + 1  # where every walk shows its last tick, however it is rounded
    yield from [frame()] * round(LAST_FRAME * FRAME_RATE)
