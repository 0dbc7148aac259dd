"""`python -m rl_cbf_clf_controller.generated.build FOLDER`: write the C of the model terms and compile it there.

What has been built from the same sources is not built again. `make build` calls this.
"""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import casadi as ca

from rl_cbf_clf_controller.generated.expressions import EXPRESSIONS
from rl_cbf_clf_controller.generated.layout import FUNCTIONS, Layout
from rl_cbf_clf_controller.generated.library import FLAGS, library_name


def make_function(name: str) -> ca.Function:
    """The function of that name: one row of arguments to one row of results, as in `layout.FUNCTIONS`.

    Raises:
        ValueError: an expression's shape is not the layout's.
    """
    arguments, results = FUNCTIONS[name]
    row = ca.SX.sym("arguments", sum(map(size, arguments.values())))
    values = EXPRESSIONS[name](*split(row, arguments))
    for (label, shape), value in zip(results.items(), values, strict=True):
        if value.numel() != size(shape):
            raise ValueError(f"{name}.{label}: {value.shape}; expected {shape}")
    flat = ca.vertcat(*(ca.vec(ca.densify(value).T) for value in values))  # row-major
    return ca.Function(name, [row], [flat], ["arguments"], ["results"], {"cse": True})


def size(shape: tuple[int, ...]) -> int:
    """How many numbers an array of that shape has."""
    total = 1
    for length in shape:
        total *= length
    return total


def split(row: ca.SX, layout: Layout) -> list[ca.SX]:
    """The arguments in a row, each flat."""
    ends = [0]
    for shape in layout.values():
        ends.append(ends[-1] + size(shape))
    return [row[start:end] for start, end in pairwise(ends)]


def build(folder: Path) -> Path:
    """The compiled library in `folder`; others there are removed.

    Raises:
        OSError: there is no compiler.
        subprocess.CalledProcessError: it failed.
    """
    library = folder / library_name()
    if library.is_file():
        return library
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as work:
        generator = ca.CodeGenerator("model_terms.c", {"with_header": False})
        for name in FUNCTIONS:
            generator.add(make_function(name))
        generator.generate(work + os.sep)
        made = Path(work) / library.name
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, *FLAGS, f"{work}/model_terms.c", "-o", str(made), "-lm"], check=True)
        made.replace(library)
    for old in set(folder.glob("model_terms-*.so")) - {library}:
        old.unlink(missing_ok=True)
    return library


if __name__ == "__main__":
    print(build(Path(sys.argv[1])))
