"""Measured scales: what is known of them for a robot that is its model, and for one of twice its mass throughout."""

from pathlib import Path

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.commands.scales import app
from rabbit_experiments.measured_scales import measure_scales
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.problem import LEAST, ROOM
from typer.testing import CliRunner

SEEDS = (5,)


def assembly(scale: float) -> Assembly:
    plant = SimulationParameters(plant="rigid", mass_scale=scale, stones=3, stop_at_miss=False)
    return Assembly(plant, load_parameters("ours", controller="rl-cbf-clf-qp"), "oracle")


def test_a_robot_that_is_its_model_has_nothing_to_estimate() -> None:
    found = measure_scales(assembly(1.0), SEEDS)
    assert set(found["alpha_scale"]) == set(found["beta_scale"]) == {LEAST}


def test_at_twice_the_mass_an_input_moves_it_half_as_much_and_presses_the_ground_the_same() -> None:
    """alpha of V is -LgV / 2, in units of |LgV| + 1; a torque's share of the contact force knows no mass."""
    found = measure_scales(assembly(2.0), SEEDS)
    V, *_, C1, C2 = found["alpha_scale"]
    assert 0.5 * ROOM / 2 < V < 0.5 * ROOM  # of four components the greatest has at least half of the length
    assert C1 == C2 == LEAST
    assert all(value > 1 for value in found["error_scale"])


def test_the_line_in_a_file_is_written_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("A = 1\nSCALES: Any = {}\nB = 2\n")
    words = ["--controller", "rl-clf-qp", "--plant", "rigid", "--stones", "2", "--walks", "1", "--into", str(file)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    first, line, last = file.read_text().splitlines()
    assert (first, last) == ("A = 1", "B = 2")
    assert line.replace("SCALES: Any", "SCALES") == done.output.strip().splitlines()[-1]
