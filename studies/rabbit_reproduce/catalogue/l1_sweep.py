"""Is the L1 baseline a fair one? Its gain, law and rate swept; first of all it must beat the CLF-QP at scale 1.2."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter
from rabbit_experiments.summary import Walks
from rabbit_experiments.walk_records import plant_in_words
from rabbit_viewer import style

from rabbit_reproduce.catalogue.flat import STEPS
from rabbit_reproduce.controllers import CLF, L1_CLF
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim
from rabbit_reproduce.table_lines import MAIN, Line, Results, Runs

SCALES = (1.2, 2.0)
GAINS = (0.01, 0.1, 1.0, 100.0, 1e4)
RATES = {1: "100 Hz", 10: "1 kHz"}
LOOKS = {"exact": (style.PURPLE, "o"), "euler": (style.ORANGE, "s")}
NAMES = {"exact": "exact", "euler": "Euler", "piecewise": "piecewise"}
WIDE = {"l1_slope_bound": 1e3, "l1_offset_bound": 1e4}
RUNS = Runs(5, 2)
TICKS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5, 1.0)  # rad


@dataclass(frozen=True)
class Setting:
    """A setting of L1; None has no meaning for the piecewise law."""

    law: str
    gain: float | None
    substeps: int
    wide: bool = False

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters of the controller."""
        gain = {} if self.gain is None else {"l1_gain": self.gain}
        return {"l1_law": self.law, "l1_substeps": self.substeps, **gain, **(WIDE if self.wide else {})}

    @property
    def text(self) -> str:
        """The setting in a table."""
        gain = "" if self.gain is None else f", gain {self.gain:g}"
        return f"L1 {NAMES[self.law]}{gain}, {RATES[self.substeps]}{', wide bounds' * self.wide}"


DEFAULT = Setting("piecewise", None, 1)
SWEPT = [Setting("piecewise", None, rate) for rate in RATES] + [
    Setting(law, gain, rate) for law in LOOKS for rate in RATES for gain in GAINS
]
UNBOUND = [Setting(law, 100.0, rate, wide=True) for law in LOOKS for rate in RATES]  # at scale 1.2 only


class L1Sweep(Experiment):
    """Ten steps on flat ground; the main plant alone."""

    name = "l1-sweep"

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        """The lines by scale and setting; without L1 by the scale alone."""
        cases = [*product(SCALES, SWEPT), *product(SCALES[:1], UNBOUND)]
        more: dict[str, Any] = {"runs": RUNS, "columns": (MAIN,)}
        lines: dict[Any, Line] = {}
        for scale in SCALES:
            lines[scale] = Line(f"{CLF.title}, scale {scale:g}", CLF.assembly(mass_scale=scale, stones=STEPS), **more)
        for scale, setting in cases:
            assembly = L1_CLF.assembly(setting.parameters, mass_scale=scale, stones=STEPS)
            lines[scale, setting] = Line(f"{setting.text}, scale {scale:g}", assembly, **more)
        return lines

    def figures(self, results: Results) -> dict[str, Figure]:
        figure, panels = style.figure(len(SCALES), height=2.1)
        for axes, scale in zip(panels, SCALES, strict=True):
            self._panel(axes, scale, results)
        style.legend(panels[0], columns=3)
        panels[-1].set_xlabel("adaptation gain")
        return {"gain": figure}

    def claims(self, results: Results) -> list[Claim]:
        """Against the CLF-QP, at scale 2, and Euler's law."""
        every = self.walks(results)
        little, twice = ({setting: every[scale, setting] for setting in SWEPT} for scale in SCALES)
        nominal, tuned = every[SCALES[0]], self.at_best(results, self.by_key[SCALES[0]])
        best = little[DEFAULT]
        better = [s for s, walks in little.items() if walks.passes and walks.rms("rms_y") < nominal.rms("rms_y")]
        failing = [setting for setting, walks in twice.items() if not walks.passes]
        unbound = []
        for setting in UNBOUND:
            walks = every[SCALES[0], setting]
            verdict = "walks" if walks.passes else f"fails after {walks.mean_stones:.1f} steps"
            unbound.append(f"{setting.text}: {verdict}")
        errors = f"rms of y {best.rms('rms_y'):.4f} against {nominal.rms('rms_y'):.4f} rad"
        whole, some = len(SWEPT), ": " + "; ".join(setting.text for setting in failing)
        return [
            self.claim(
                "better",
                f"{errors}; better with {len(better)} of {whole} settings",
                {"walks": best.passes, "better": DEFAULT in better},
                tuned=(
                    f"rms of y {tuned.rms('rms_y'):.4f} rad",
                    tuned.passes and tuned.rms("rms_y") <= best.rms("rms_y"),
                ),
            ),
            self.claim(
                "fails",
                f"fails with {len(failing)} of {whole} settings{some * bool(failing)}",
                {"with some": bool(failing), "with all": len(failing) == whole},
            ),
            self.claim("euler", "; ".join(unbound)),
        ]

    def _panel(self, axes: Axes, scale: float, results: Results) -> None:
        """Draws the panel of a scale."""
        every = self.walks(results)
        for (law, (colour, marker)), (substeps, rate) in product(LOOKS.items(), RATES.items()):
            walks = [every[scale, Setting(law, gain, substeps)] for gain in GAINS]
            line, fill = ("-", colour) if substeps == 1 else ("--", "white")
            look: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": line, "markerfacecolor": fill}
            axes.plot(GAINS, _errors(walks), label=f"{NAMES[law]}, {rate}", markersize=4, **look)
            bad = [not runs.passes for runs in walks]
            axes.plot(np.array(GAINS)[bad], _errors(walks)[bad], "x", color=style.RED, markersize=9)
        piecewise, nominal = (every[key].rms("rms_y") for key in ((scale, DEFAULT), scale))
        axes.axhline(piecewise, color=style.GREEN, linestyle=":", label="piecewise, 100 Hz")
        axes.axhline(nominal, color=CLF.colour, linestyle=CLF.line, label=CLF.title)
        axes.margins(y=0.12)
        axes.set(xscale="log", yscale="log", ylabel="rms of $y$ (rad)")
        axes.text(0.5, 0.97, plant_in_words({"mass_scale": scale}), transform=axes.transAxes, ha="center", va="top")
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_yticks([tick for tick in TICKS if axes.get_ylim()[0] <= tick <= axes.get_ylim()[1]])


def _errors(walks: Sequence[Walks]) -> Any:
    return np.array([runs.rms("rms_y") for runs in walks])
