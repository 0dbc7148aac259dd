"""`python -m rl_cbf_clf_controller.compile_traces FOLDER`: compile the traces of the usual controllers' ticks there."""

import sys
from pathlib import Path
from typing import Any

from cbf_clf_qp import tracing
from rabbit_description.gait import load_gaits

from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.generated.traces import compile_trace
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy

USUAL = (
    {"controller": "rl-cbf-clf-qp"},
    {"controller": "rl-clf-qp"},
    {
        "controller": "rl-cbf-clf-qp",
        "gait": "paper_stones",
        "adaptation": "identification",
        "objective": "pd_centred",
    },
)


def compile_usual(folder: Path) -> None:
    """Those of the usual controllers, each found by letting it compute; others there are removed."""
    made = set[Path]()

    def compile_it(function: Any) -> Any:
        made.add(compile_trace(function, folder))
        return function

    tracing.compiled = compile_it
    for values in USUAL:
        parameters = ControllerParameters.model_validate(values)
        Controller(parameters, load_gaits(parameters.gait), ZeroPolicy(parameters.problem)).rehearse()
    for old in set(folder.glob("trace-*.so")) - made:
        old.unlink(missing_ok=True)


if __name__ == "__main__":
    compile_usual(Path(sys.argv[1]))
