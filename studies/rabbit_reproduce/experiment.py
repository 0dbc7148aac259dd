"""What every experiment is: claims of the paper, the lines of its table, and its figures.

`catalogue/claims.yaml` has the words and settings of each, by its name.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

from matplotlib.figure import Figure
from rabbit_description.yaml_file import read_mapping
from rabbit_experiments import provenance
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import POLICY
from rabbit_experiments.evaluation import SeededRun
from rabbit_experiments.summary import Walks
from rabbit_viewer import style

from rabbit_reproduce.controllers import AT_ITS_BEST, Contender
from rabbit_reproduce.curves import rate_figure
from rabbit_reproduce.report import Claim, Report, Table, Verdict, judge
from rabbit_reproduce.table_lines import MAIN, RIGID, Line, Results, Runs, Size, runs_table
from rabbit_reproduce.training import TrainingJob, that_made

FIGURES = ("fig:Main", "fig:clf-results", "fig:clf-torso-results", "fig:stepping-stone", "fig:rl-cbf-clf-results")
SWEPT = Runs(10, 1)  # there are many values


class Experiment(ABC):
    """One figure or claim of the paper. `label` is the paper's own, in brackets, or the section's name.

    One that `needs_training` is made with `--retrain` only. `told` has the words of its claims.
    """

    name: str
    title: str
    label: str
    paper: str
    told: Mapping[str, Mapping[str, str]]
    judged_on_rigid: bool = False  # all claims hold of any plant's walks, but for those made on `MAIN` alone
    needs_training: bool = False
    shown: ClassVar[Sequence[Any]] = ()  # keys of the lines whose first run a figure shows

    @property
    def place(self) -> str:
        """Where in the paper, its figure by number."""
        return f"Fig. {FIGURES.index(self.label) + 1}, {self.label}" if self.label in FIGURES else self.label

    def __init__(self, name: str = "") -> None:
        self.name = name or self.name
        vars(self).update(catalogued()[self.name])

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        """What walks, each line under a key of the experiment's own."""
        return {}

    def compared(self) -> Iterable[Line]:
        """The lines whose plants the nominal controller at its best walks as well."""
        return self.by_key.values()

    @cached_property
    def tuned(self) -> dict[Any, Line]:
        """The lines of that controller, by plant and by whether there are force rows."""
        lines: dict[Any, Line] = {}
        for line in self.compared():
            lines.setdefault(_place(line), _tuned(line))
        return lines

    def at_best(self, results: Results, line: Line) -> Walks:
        """That controller's runs where `line` walks."""
        return results.walks(self.tuned[_place(line)])

    def lines(self) -> Sequence[Line]:
        """The lines in the order of the table."""
        return [*self.by_key.values(), *self.tuned.values()]

    def walks(self, results: Results) -> dict[Any, Walks]:
        """The runs of each line."""
        return {key: results.walks(line) for key, line in self.by_key.items()}

    @abstractmethod
    def claims(self, results: Results) -> list[Claim]:
        """The verdicts."""

    def claim(
        self,
        name: str,
        ours: str,
        parts: Mapping[str, bool] | None = None,
        nominal: bool = False,
        tuned: Walks | tuple[str, bool] = ("-", False),
        **words: str,
    ) -> Claim:
        """The claim told under this name, with `words` in it; without `parts` (see `judge`) it has no verdict.

        `tuned`: the walks of the nominal controller at its best, or what it does, and whether that undoes the claim.
        """
        told = {what: text.format(**words) for what, text in self.told[name].items()}
        text, undone = (tuned.text, tuned.passes) if isinstance(tuned, Walks) else tuned
        verdict = judge(parts, nominal) if parts else Verdict.OPEN
        return Claim(**told, ours=ours, verdict=verdict, tuned=text, undone=undone)

    def figures(self, results: Results) -> dict[str, Figure]:
        """The figures by name."""
        return {}

    def jobs(self, size: Size) -> list[SeededRun]:
        """Every run it needs."""
        scenarios = [line.scenario(size, column) for line in self.lines() for column in size.columns(line.columns)]
        recorded = [self.by_key[key].scenario(size).recorded for key in self.shown]
        return [*(job for scenario in scenarios for job in scenario.walks), *recorded]

    def trainings(self, size: Size) -> list[TrainingJob]:
        """What `--retrain` trains for it: the shipped policies that it uses."""
        return that_made(assembly.policy for job in self.jobs(size) for assembly in job.assemblies)

    def tables(self, results: Results) -> Sequence[Table]:
        """The tables of its lines."""
        return (runs_table(self.lines(), results),)

    def _claims(self, results: Results) -> list[Claim]:
        """The claims with the verdicts on the rigid plant."""
        is_beside = self.judged_on_rigid and results.size.columns([RIGID])
        beside = self.claims(results.on_rigid) if is_beside else []
        verdicts = {claim.claim: claim.verdict for claim in beside}
        return [claim.model_copy(update={"on_rigid": verdicts.get(claim.claim)}) for claim in self.claims(results)]

    def report(self, results: Results) -> Report:
        """The report from results that are all there; raises `LookupError` where one is not."""
        size = results.size
        with style.look():
            figures = self.figures(results)
        learned = [job.assembly for job in self.jobs(size) if job.assembly.policy not in ("zero", "oracle")]
        policies = {policy_name(assembly): assembly.make_policy().version for assembly in learned}
        options = " --quick" * size.quick + " --retrain" * (size.trained is not None)
        options += f" --plant {size.plant}" * (size.plant != "pybullet")
        about = {
            "label": self.label,
            "title": self.title,
            "plant": size.plant,
            "policies": "; ".join(f"{name} {version}" for name, version in policies.items()),
            "commit": provenance.commit(),
            "command": f"rabbit reproduce {self.name}{options}",
        }
        return Report(self.name, about, self._claims(results), self.tables(results), figures)


class Sweep(Experiment):
    """`field` of the plant takes `values`; `plants` has each controller's plant apart from it.

    `axis` names the parameter with its unit, of which there are `scale` in the field's own; `paper_values` has what the
    paper says of single cells; where `nominal` walks too, a row shows nothing.
    """

    field: str
    values: Sequence[float]
    plants: ClassVar[Mapping[Contender, dict[str, Any]]]
    axis: str
    scale: float = 1.0
    paper_values: ClassVar[Mapping[tuple[Contender, float], str]] = {}

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        return {(contender, value): self._line(contender, value) for contender in self.plants for value in self.values}

    def row(self, results: Results, contender: Contender) -> dict[float, Walks]:
        """A controller's runs, by value."""
        return {value: results.walks(self.by_key[contender, value]) for value in self.values}

    def row_at_best(self, results: Results, contender: Contender) -> dict[float, Walks]:
        """The runs of the nominal controller at its best on the plants of another."""
        return {value: self.at_best(results, self.by_key[contender, value]) for value in self.values}

    def figures(self, results: Results) -> dict[str, Figure]:
        rates = {contender: list(self.row(results, contender).values()) for contender in self.plants}
        return {"rates": rate_figure(self.values, rates, self.axis, self.scale, list(self.paper_values))}

    def largest(self, walks: Mapping[float, Walks]) -> str:
        """The largest value that walks, in words, and up to which one all do."""
        ordered = sorted(walks.items())
        passing = [value for value, runs in ordered if runs.passes]
        whole = [value for i, (value, _) in enumerate(ordered) if all(runs.passes for _, runs in ordered[: i + 1])]
        if not passing:
            return "walks at none"
        if whole and whole[-1] == passing[-1]:
            return f"walks up to {self._text(whole[-1])}"
        up_to = f"without a hole up to {self._text(whole[-1])}" if whole else "not at the least"
        return f"largest {self._text(passing[-1])}, {up_to}"

    def _text(self, value: float) -> str:
        return f"{value * self.scale:g} {self.axis.rpartition('(')[2].rstrip(')')}"

    def _line(self, contender: Contender, value: float) -> Line:
        assembly = contender.assembly(**self.plants[contender], **{self.field: value})
        paper = self.paper_values.get((contender, value), "")
        return Line(f"{contender.title}, {self._text(value)}", assembly, paper, runs=SWEPT)


def forces_kept(walks: Walks) -> tuple[str, bool]:
    """How often walks leave the friction cone, in words, and whether they reach the end and never leave it."""
    over = walks.total("ticks_over_cone")
    text = f"{walks.rate_text}; {over} of {walks.total('ticks')} ticks over, largest {walks.max_ratio:.2f}"
    return text, walks.passes and over == 0


def _place(line: Line) -> tuple[Any, bool]:
    return line.assembly.simulation, line.assembly.controller.force_rows


def _tuned(line: Line) -> Line:
    """The nominal controller at its best on the plant of a line, on the plants that claims are judged on."""
    plant, force_rows = _place(line)
    contender = AT_ITS_BEST[plant.terrain]
    assembly = contender.assembly({"force_rows": force_rows}, **plant.model_dump())
    columns = tuple(column for column in line.columns if column in (MAIN, RIGID))
    return Line(f"{contender.title}, where: {line.what}", assembly, runs=line.runs, columns=columns)


@cache
def catalogued() -> dict[str, Any]:
    """What claims.yaml says of each experiment."""
    return read_mapping(Path(__file__).parent / "catalogue" / "claims.yaml")


def policy_name(assembly: Assembly) -> str:
    """What a policy file is called: its own name, or its training's."""
    path = Path(assembly.policy)
    return path.parent.name if path.name == POLICY else path.stem
