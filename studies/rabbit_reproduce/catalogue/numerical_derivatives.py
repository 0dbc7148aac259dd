"""Numerical differentiation of noisy measurements, with a filter and without (Discussion)."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rabbit_description.gait import load_gait
from rabbit_description.state import Array
from rabbit_viewer import style

from rabbit_reproduce.controllers import CBF_CLF_ORACLE
from rabbit_reproduce.curves import WIDTH
from rabbit_reproduce.differentiation import METHODS, QUANTITIES, relative_errors, steps
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Cell, Claim, Table
from rabbit_reproduce.table_lines import MAIN, Found, Line

NOISE = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)  # rad/s
USUAL = 0.15  # the error that an estimate may have, docs/results_paper.md
LOOKS = {"one difference": (style.BLACK, "o", "-"), "low-pass": (style.ORANGE, "s", "--")}
LOOKS |= {"Savitzky-Golay": (style.BLUE, "^", "-.")}
NAMES = {"V": r"$\dot V$", "B1": r"$\ddot B_1$", "B2": r"$\ddot B_2$"}
CAPTION = (
    "Error of the measured derivatives against the noise of the measured rates, relative to the model's error that is "
    "to be learned from them; states of the oracle's first walk at scale 2. 1: the noise is as large as what is sought."
)


class NumericalDerivatives(Experiment):
    """On the oracle's walk; how the walk itself takes noise is `velocity-noise`."""

    name = "numerical-derivatives"
    title = "Numerical derivatives under noise, with a filter and without"
    label = "sec:discussion"
    paper = "The derivatives measured by numerical differentiation could be noisy in experiments; no figure is given."

    shown = (CBF_CLF_ORACLE,)

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        assembly = CBF_CLF_ORACLE.assembly(mass_scale=2.0)
        return {CBF_CLF_ORACLE: Line(CBF_CLF_ORACLE.title, assembly, columns=(MAIN,))}

    def tables(self, found: Found) -> Sequence[Table]:
        errors = self._errors(found)
        columns = ("noise (rad/s)", *(f"{quantity}, {method}" for quantity in QUANTITIES for method in METHODS))
        rows: list[tuple[Cell, ...]] = [
            (f"{sigma:g}", *(f"{errors[method][i, j]:.3f}" for j in range(len(QUANTITIES)) for method in METHODS))
            for i, sigma in enumerate(NOISE)
        ]
        return Table(name="errors", columns=columns, rows=tuple(rows)), *super().tables(found)

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        return {"derivatives": (CAPTION, _figure(self._errors(found)))}

    def claims(self, found: Found) -> list[Claim]:
        """How much noise each way of differentiation takes."""
        errors = self._errors(found)
        return [
            Claim(
                claim=f"noise up to which {name} is measured within {USUAL:g} of the model's error",
                paper="could be noisy",
                ours="; ".join(f"{method} {_most(errors[method][:, i])}" for method in METHODS),
            )
            for i, name in enumerate(QUANTITIES)
        ]

    def _errors(self, found: Found) -> Mapping[str, Array]:
        """Relative errors (noise, quantity) by method."""
        line = self.by_key[CBF_CLF_ORACLE]
        scenario = line.scenario(found.size)
        walked = steps(found.records(line), load_gait(scenario.assembly.controller.gait), scenario.seed)
        return {
            method: np.array([relative_errors(walked, derivative, sigma) for sigma in NOISE])
            for method, derivative in METHODS.items()
        }


def _most(errors: Array) -> str:
    """The largest noise with an error within bounds, none of the smaller ones beyond."""
    within = np.cumprod(errors <= USUAL).astype(bool)
    return f"{np.array(NOISE)[within][-1]:g} rad/s" if within.any() else "none"


def _figure(errors: Mapping[str, Array]) -> Figure:
    """A panel for each quantity."""
    figure, panels = style.figure(len(QUANTITIES), height=1.7, width=WIDTH)
    for i, (axes, quantity) in enumerate(zip(panels, QUANTITIES, strict=True)):
        for method, values in errors.items():
            colour, marker, line = LOOKS[method]
            axes.plot(NOISE[1:], values[1:, i], color=colour, marker=marker, linestyle=line, markersize=4, label=method)
        style.limit(axes, USUAL, f"{USUAL:g}, as estimates have")
        axes.set(xscale="log", yscale="log", ylabel=f"error of {NAMES[quantity]}")
    panels[-1].set_xticks(NOISE[1:], [f"{sigma:g}" for sigma in NOISE[1:]])
    panels[-1].tick_params(axis="x", which="minor", bottom=False)
    panels[-1].set_xlabel("standard deviation of the measured rates (rad/s)")
    style.legend(panels[0])
    figure.align_ylabels()
    return figure
