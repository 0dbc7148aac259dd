"""The samples of a soak as a picture: memory, descriptors and threads of each node, the rate and what a tick takes."""

from pathlib import Path

import numpy as np
from rabbit_viewer import style

from rabbit_campaigns.soak import WALKERS, Samples, nodes_in

COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.BLACK, style.RED)
SMOOTH_SECONDS = 60.0


def draw_soak(samples: Samples, path: Path) -> Path:
    """Draw it; returns the path."""
    minutes = samples["seconds"] / 60
    with style.look():
        figure, (memory, descriptors, threads, rate, cpu) = style.figure(5, height=1.6)
        for node, colour in zip(nodes_in(samples), COLOURS, strict=False):
            memory.plot(minutes, samples[f"{node}_memory"], color=colour, label=node)
            descriptors.plot(minutes, samples[f"{node}_descriptors"], color=colour)
            threads.plot(minutes, samples[f"{node}_threads"], color=colour)
        many = max(1, round(SMOOTH_SECONDS / max(np.median(np.diff(samples["seconds"])), 1e-9)))
        many = min(many, len(minutes) - 1)
        ticks, seconds = samples["ticks"], samples["seconds"]
        walked = np.maximum(ticks[many:] - ticks[:-many], 1)
        rate.plot(minutes[many:], walked / (seconds[many:] - seconds[:-many]), color=style.BLUE)
        used = np.sum([samples[f"{node}_cpu"] for node in WALKERS], axis=0)
        cpu.plot(minutes[many:], (used[many:] - used[:-many]) / walked * 1e3, color=style.BLUE)
        labels = ("memory (MB)", "descriptors", "threads", "ticks per second", "CPU a tick (ms)")
        for axes, label in zip((memory, descriptors, threads, rate, cpu), labels, strict=True):
            axes.set_ylabel(label)
            axes.set_ylim(bottom=0)
        cpu.set_xlabel("time (min)")
        style.legend(memory, columns=5)
        return style.save(figure, path)
