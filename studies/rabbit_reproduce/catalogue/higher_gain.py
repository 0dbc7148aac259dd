"""What learning buys beyond a higher gain: courses walked over mass and payload, nominal control tuned (ours)."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any

from matplotlib.figure import Figure
from rabbit_viewer import style

from rabbit_reproduce.controllers import (
    AT_ITS_BEST,
    BEST,
    CBF_CLF,
    CBF_CLF_ORACLE,
    LIBRARY,
    MARGIN,
    RL_CBF_CLF,
    Contender,
    variant,
)
from rabbit_reproduce.curves import draw_rates
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim
from rabbit_reproduce.table_lines import HEADLINE, MAIN, MUJOCO, Line, Results

SEED = 50006  # of these courses and of nothing else
ENGINES = (MAIN, MUJOCO)
HIGH_GAIN = variant("nominal, high gain (eps 0.01)", "cbf-clf-qp", "zero", LIBRARY, MARGIN, {"eps": 0.01})
WHO = (
    replace(CBF_CLF, title="nominal, eps 0.04"),
    replace(AT_ITS_BEST["stones"], colour=style.ORANGE, line="--"),
    replace(HIGH_GAIN, colour=style.PURPLE, line="-."),
    replace(RL_CBF_CLF, title="the paper's policy, eps 0.04"),
    replace(CBF_CLF_ORACLE, title="oracle, eps 0.04: exact estimates"),
    replace(BEST["stones"], title="best: identifies the robot"),
)


class HigherGain(Experiment):
    """`swept` has the values of each field of the plant, `axis` what it is, `unit` its unit."""

    name = "higher-gain"
    swept: dict[str, list[float]]
    axis: dict[str, str]

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        return {
            (who, field, value): self._line(who, field, value)
            for who in WHO
            for field, values in self.swept.items()
            for value in values
        }

    def compared(self) -> Iterable[Line]:
        """The lines to compare: none, since it is one of them."""
        return ()

    def claims(self, results: Results) -> list[Claim]:
        """Where each walks; ours, so without a verdict on the paper."""
        walks = self.walks(results)
        claims = []
        for who in WHO:
            passed = [
                f"{self.axis[field].partition(' (')[0]} "
                + (", ".join(f"{value:g}" for value in values if walks[who, field, value].passes) or "none")
                for field, values in self.swept.items()
            ]
            claims.append(self.claim("walks", "; ".join(passed), who=who.title))
        return claims

    def figures(self, results: Results) -> dict[str, Figure]:
        figure, panels = style.figure(len(self.swept), height=3.0, sharex=False)
        walks = self.walks(results)
        for axes, (field, values) in zip(panels, self.swept.items(), strict=True):
            draw_rates(axes, values, {who: [walks[who, field, value] for value in values] for who in WHO})
            axes.set_xlabel(self.axis[field])
        style.legend(panels[0], columns=2)
        return {"rates": figure}

    def _line(self, who: Contender, field: str, value: float) -> Line:
        what = f"{who.title}, {self.axis[field]}: {value:g}"
        return Line(what, who.assembly(**{field: value}), runs=HEADLINE, columns=ENGINES, seed=SEED)
