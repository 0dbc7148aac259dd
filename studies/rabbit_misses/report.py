"""What `rabbit misses` leaves: the model, a page with the bins, and a picture of p against what happened."""

from pathlib import Path

from matplotlib.figure import Figure
from rabbit_description.atomic_file import replace_text
from rabbit_description.state import Array
from rabbit_experiments import provenance
from rabbit_experiments.summary import wilson
from rabbit_experiments.tables import markdown_table
from rabbit_viewer import style

from rabbit_misses.model import MissProbability
from rabbit_misses.study import DEMANDED, JUDGE_SEED, Judgement


def write(model: MissProbability, judgement: Judgement, p: Array, missed: Array, plants: int, out: Path) -> Path:
    """`model.json`, `misses.md`, `misses.png` in the folder `out`; returns the page."""
    style.save(figure(judgement), out / "misses.png", dpi=110)
    replace_text(out / "model.json", model.model_dump_json(indent=1))
    page = out / "misses.md"
    replace_text(page, text(model, judgement, p, missed, plants))
    return page


def text(model: MissProbability, judgement: Judgement, p: Array, missed: Array, plants: int) -> str:
    """The page."""
    sure = p <= DEMANDED
    low, high = wilson(int(missed[sure].sum()), int(sure.sum())) if sure.any() else (0.0, 1.0)
    rows = []
    for group in judgement.bins:
        place, rate = f"{100 * group.low:g} to {100 * group.high:g}%", f"{100 * group.misses / group.steps:.1f}%"
        ends = f"{100 * group.interval[0]:.1f} to {100 * group.interval[1]:.1f}%"
        holds = "yes" if group.holds else "no"
        rows.append((place, f"{group.steps}", f"{100 * group.p:.1f}%", f"{group.misses}", rate, ends, holds))
    lines = [
        "# The probability of a miss",
        "",
        f"`{provenance.command()}`, commit {provenance.commit()}. Fitted on {model.fitted_on}.",
        f"Judged on {len(p)} steps with {int(missed.sum())} misses, on {plants} other plants of the storm, seed",
        f"{JUDGE_SEED}.",
        "",
        markdown_table(("p", "steps", "mean p", "misses", "rate", "95% interval", "mean p in it"), rows),
        f"Brier score {judgement.brier:.4f}, that of the mean rate {judgement.brier_of_rate:.4f}: skill "
        f"{judgement.skill:.3f}.",
        "",
        f"Of all steps {100 * sure.mean():.0f}% begin with p of at most {100 * DEMANDED:g}%. Of these "
        f"{100 * missed[sure].mean() if sure.any() else 0:.2f}% missed ({100 * low:.2f} to {100 * high:.2f}%).",
        "",
    ]
    return "\n".join(lines)


def figure(judgement: Judgement) -> Figure:
    """Mean p of each bin against the rate of misses, with its interval."""
    figure = Figure(figsize=(4.5, 4.5), layout="constrained")
    axes = figure.add_subplot()
    rates = [group.misses / group.steps for group in judgement.bins]
    below = [rate - group.interval[0] for rate, group in zip(rates, judgement.bins, strict=True)]
    above = [group.interval[1] - rate for rate, group in zip(rates, judgement.bins, strict=True)]
    axes.errorbar([group.p for group in judgement.bins], rates, [below, above], fmt="o", color=style.BLUE, capsize=3)
    axes.plot([0.003, 1], [0.003, 1], color=style.BLACK, linewidth=0.8)
    axes.set(xscale="log", yscale="log", xlabel="probability that is given", ylabel="rate of misses", xlim=(0.003, 1))
    axes.set_ylim(0.001, 1)
    return figure
