"""A tuner: settings of what the paper does not print, tried on chosen experiments (Optuna's TPE).

python -m rabbit_reproduce.search RANGES.yaml EXPERIMENT ... --trials 40 --plant rigid --out DIR

    maximise   number of the experiments' claims that hold, of quick runs, over the ranges

RANGES.yaml has low and high of numbers (`controller: {eps: [0.02, 0.2]}`) or a list of names. DIR/search.log has the
trials, from which the same command goes on; DIR/NUMBER/results.md is a trial's page, DIR/best.yaml the best setting.
`settings/most_claims.yaml` was found by such a search, policies trained anew in each trial.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import own_folder
from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import FileError
from rabbit_description.yaml_file import dump_yaml, read_mapping

from rabbit_reproduce.catalogue import EXPERIMENTS
from rabbit_reproduce.page import make
from rabbit_reproduce.report import Verdict, read_report
from rabbit_reproduce.setting import Setting
from rabbit_reproduce.table_lines import QUICK

SEED = 52001  # of trials and of nothing else


def suggested(trial: Any, ranges: dict[str, dict[str, list[Any]]], plant: str) -> Setting:
    """What Optuna proposes; numbers above zero on a logarithmic scale."""
    values: dict[str, Any] = {"plant": plant}
    for part, names in ranges.items():
        for name, box in names.items():
            if any(isinstance(each, str) for each in box):
                value = trial.suggest_categorical(name, box)
            else:
                value = trial.suggest_float(name, *box, log=box[0] > 0)
            values.setdefault(part, {})[name] = value
    return Setting.model_validate(values)


def search(
    ranges: Annotated[Path, typer.Argument(help="YAML file of ranges")],
    experiments: Annotated[list[str], typer.Argument(help="whose claims are counted, by name")],
    out: Annotated[Path, typer.Option(help="folder; one that was stopped there goes on")] = Path("runs/search"),
    trials: Annotated[int, typer.Option(min=1, help="number of trials")] = 40,
    plant: Annotated[str, typer.Option(help="pybullet, mujoco or rigid")] = "pybullet",
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 1,
) -> None:
    """Search the setting under which most claims of these experiments hold, written after each trial."""
    import optuna
    from optuna.storages.journal import JournalFileBackend, JournalStorage

    chosen = [each for each in EXPERIMENTS if each.name in experiments]
    if len(chosen) != len(set(experiments)):
        fail(f"{' '.join(experiments)}: expected experiments (`rabbit reproduce --list`)")
    with complaints(FileError):
        boxes = read_mapping(ranges)
    own_folder(out, "search")
    storage = JournalStorage(JournalFileBackend(str(out / "search.log")))
    sampler = optuna.samplers.TPESampler(seed=SEED, multivariate=True)
    study = optuna.create_study(
        storage=storage, study_name="claims", direction="maximize", load_if_exists=True, sampler=sampler
    )

    def held(trial: Any) -> int:
        setting, folder = suggested(trial, boxes, plant), out / str(trial.number)
        make(chosen, replace(QUICK, setting=setting, seed=SEED), folder, experiments, jobs)
        reports = [report for each in chosen if (report := read_report(folder / each.name))]
        trial.set_user_attr("setting", dump_yaml(setting.model_dump(mode="json")))
        return sum(claim.verdict is Verdict.REPRODUCED for report in reports for claim in report.claims)

    while len(study.get_trials(states=(optuna.trial.TrialState.COMPLETE,))) < trials:
        study.optimize(held, n_trials=1)
        replace_text(out / "best.yaml", study.best_trial.user_attrs["setting"])
    print(f"written {out / 'best.yaml'}")


if __name__ == "__main__":
    typer.run(search)
