"""Text for many pictures of the same size: every letter is drawn once, then copied."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

POINTS, DPI = 11, 100
WIDTH, HEIGHT, BASELINE = 9, 19, 5  # pixels of a letter's cell, and of what hangs below its line


class Lettering:
    """Black letters of one width."""

    def __init__(self) -> None:
        self._cells: dict[str, NDArray[np.uint8]] = {}

    def write(self, picture: NDArray[np.uint8], text: str, left: int, top: int) -> None:
        """Put `text` into a picture (height, width, 4), its first line's corner at (left, top), pixels."""
        for i, line in enumerate(text.split("\n")):
            for k, letter in enumerate(line):
                x, y = left + k * WIDTH, top + i * HEIGHT
                place = picture[y : y + HEIGHT, x : x + WIDTH, :3]
                np.minimum(place, self._cell(letter)[: place.shape[0], : place.shape[1]], out=place)

    def _cell(self, letter: str) -> NDArray[np.uint8]:
        """(HEIGHT, WIDTH, 3), black on white."""
        if letter not in self._cells:
            figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
            canvas = FigureCanvasAgg(figure)
            figure.text(0.0, BASELINE / HEIGHT, letter, fontsize=POINTS, family="monospace", parse_math=False)
            canvas.draw()
            self._cells[letter] = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        return self._cells[letter]
