"""A walk as a film: MP4, and a small GIF made from it. The encoder is the one that imageio-ffmpeg brings."""

import subprocess
from pathlib import Path

import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
from rabbit_description.state import TICK_SECONDS

from rabbit_viewer.scene import SIZE, Scene
from rabbit_viewer.walk_records import WalkRecords

FRAME_RATE = 25  # 1/s
LAST_FRAME = 0.8  # s, for which the last frame stays
GIF_RATE, GIF_WIDTH = 12.5, 480


class VideoError(RuntimeError):
    """The encoder failed."""


def film(walk: WalkRecords, path: Path, speed: float = 1.0) -> Path:
    """Write an MP4 of the walk at `speed` times real time.

    Raises:
        VideoError: the encoder failed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    scene = Scene(walk)
    ticks = len(walk.tick)
    rows = np.arange(0, ticks - 1, speed / (FRAME_RATE * TICK_SECONDS)).astype(int).tolist()
    options = {"fps": FRAME_RATE, "pix_fmt_in": "rgba", "macro_block_size": 2, "codec": "libx264"}
    writer = imageio_ffmpeg.write_frames(str(path), SIZE, **options, output_params=["-preset", "veryfast"])
    try:
        writer.send(None)
        for row in rows:
            writer.send(scene.frame(row).tobytes())
        last = scene.frame(ticks - 1).tobytes()
        for _ in range(round(LAST_FRAME * FRAME_RATE)):
            writer.send(last)
    except OSError as error:
        raise VideoError(f"{path}: {error}") from error
    finally:
        writer.close()
    return path


def as_gif(video: Path) -> Path:
    """A GIF beside an MP4, smaller and at half its frames.

    Raises:
        VideoError: the encoder failed.
    """
    path = video.with_suffix(".gif")
    chain = (
        f"fps={GIF_RATE},scale={GIF_WIDTH}:-1:flags=area,split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse"
    )
    encoder = imageio_ffmpeg.get_ffmpeg_exe()
    words = [encoder, "-y", "-loglevel", "error", "-i", str(video), "-filter_complex", chain, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise VideoError(f"{path}: {done.stderr.strip()}")
    return path
