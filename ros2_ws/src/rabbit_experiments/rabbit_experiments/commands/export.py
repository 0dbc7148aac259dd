"""Write a controller as C source, with a program that walks it in MuJoCo's C library."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, options
from rabbit_common.own_folder import own_folder
from rabbit_description.validation import Checked
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

DEFAULTS = Defaults(always={"plant": "mujoco", "mass_scale": 2.0, "qp_solver": "daqp"})

app = typer.Typer(add_completion=False)


class ExportOptions(Checked):
    """The options of `rabbit export` besides those of the controller and of the plant that the example walks."""

    parameters: str = Field("best", description="controller parameters: best, ours, nominal_tuned or a YAML file")
    policy: str = Field("zero", description="zero, a shipped policy or a file")
    seed: int = Field(9001, ge=0, le=2**32 - 1, description="seed of the example's course and first state")
    daqp: Path | None = Field(None, description="csrc of DAQP's source (default: from PyPI)")


@app.command()
@options(ExportOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def export(
    given: Given, folder: Annotated[Path, typer.Argument(help="a new or empty folder, or one of an earlier export")]
) -> None:
    """Write a controller as C source, with a program that walks it in MuJoCo's C library.

    Example: `rabbit export c --parameters best && make -C c && (cd c && ./example)`
    """
    from rabbit_experiments.assembly import exported_estimator
    from rabbit_experiments.commands.evaluate import given_assembly

    request = given.build(ExportOptions)
    assembly = given_assembly(given, request.policy, request.parameters, oracle=False)
    from rabbit_sim.c_example import ExampleError, check_plant, write_example
    from rl_cbf_clf_controller.export import ExportError
    from rl_cbf_clf_controller.export import export as write

    with complaints(ExampleError):
        check_plant(assembly.simulation)
    simulation, controller = assembly.build()
    own_folder(folder, "export")
    with complaints(ExportError), TemporaryDirectory() as temporary:
        daqp = request.daqp or daqp_source(Path(temporary))
        write(controller, folder, daqp, exported_estimator(assembly.simulation))
    write_example(folder, simulation, request.seed)
    print(f"written to {folder}: controller.c, controller.h, daqp/, and an example: make -C {folder}")


def daqp_source(folder: Path) -> Path | None:
    """DAQP's source, in this folder; None, and a line, where it cannot be had."""
    from cbf_clf_qp.daqp_source import SourceError, unpack_daqp

    try:
        return unpack_daqp(folder)
    except SourceError as error:
        instead = "In daqp/ is the library of CasADi's wheel, for this platform; --daqp takes a folder of the source"
        print(f"rabbit: {error}. {instead}", file=sys.stderr)
        return None
