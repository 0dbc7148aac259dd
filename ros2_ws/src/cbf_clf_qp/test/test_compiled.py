"""Compiled functions: the same bits, in any number of processes, and without a compiler; functions, estimates."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, NumpyFunction, System, Tick, compiled
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import OFTEN

SCRIPT = """
import resource, sys
import casadi as ca
import numpy as np
from cbf_clf_qp import NumpyFunction
x = ca.SX.sym("x", 3)
functions = [NumpyFunction.of(f"f{i}", {"x": x}, {"y": ca.sin(x) / 3 + i}) for i in (0, 1)]
if "full" in sys.argv:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
for function in functions:
    function.compile(wait="leave" not in sys.argv)
    print(function(np.arange(3.0)).row.tobytes().hex(), function.fastest is not function.function)
"""
ROWS = [(np.sin(np.arange(3.0)) / 3 + i).tobytes().hex() for i in (0, 1)]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in (compiled.COMPILE, compiled.CACHE, "CC"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "cbf_clf_qp"


def smooth() -> NumpyFunction:
    """Every kind of operation."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    found = {"a": ca.vertcat(ca.sin(x[0]) / x[1], ca.exp(-(x[2] ** 2)), x[0] ** 3, 2 * x[1], ca.tanh(x[2]) + y)}
    found |= {"b": ca.vertcat(ca.fmax(x[0], y), ca.if_else(x[0] > x[1], x[2], -x[2]), ca.fabs(x[1]), 7, y)}
    found |= {"c": ca.vertcat(ca.logic_or(x[0] > 0, x[1] > 0), ca.sign(x[2]), ca.sqrt(x[0]), 1 / x[1], x[1] ** y)}
    found |= {"d": ca.vertcat(ca.cos(x[0]) * x[1] + x[2], ca.atan2(x[0], x[1]), ca.fmin(x[0], y), ca.log(x[2]))}
    return NumpyFunction.of("f", {"x": x, "y": y}, found)


def with_daqp() -> NumpyFunction:
    """A cart that goes to x = 1, with a wall."""
    x, v, u, wall = (ca.SX.sym(name) for name in ("x", "v", "u", "wall"))
    cart = System(ca.vertcat(x, v), u, ca.vertcat(v, u / 2.0), parameters=[wall])
    tick = Tick(cart, [Clf(x - 1, eps=0.2), Barrier("wall", wall - x, poles=(8, 8))], limit=100, solver="daqp")
    return tick.answer.with_daqp


def inputs(function: NumpyFunction, n: int) -> list[np.ndarray[Any, Any]]:
    """N rows of each input: of all sizes, and some that are no numbers."""
    rng = np.random.default_rng(0)
    rows = [rng.normal(size=(n, size)) * 10 ** rng.uniform(-4, 3, (n, 1)) for _, size, _ in function.arguments]
    for i, value in enumerate((0.0, -0.0, np.inf, -np.inf, np.nan, 1e200)):
        row = rows[i % len(rows)]
        row[i :: max(n // 5, 7), i % row.shape[1]] = value
    return rows


def same(one: Any, other: Any) -> bool:
    """To the bit, but for those of NaN."""
    one, other = (np.nan_to_num(values, nan=1.5e300, posinf=np.inf, neginf=-np.inf) for values in (one, other))
    return bool(one.tobytes() == other.tobytes())


def run(*given: str, **environment: str) -> tuple[list[list[str]], str]:
    """What the script says, line by line, and its stderr."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *given], env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()], done.stderr


@pytest.mark.parametrize("make", [smooth, with_daqp])
def test_bits_are_those_of_the_virtual_machine_alone_and_many_at_once(make: Any) -> None:
    function, n = make(), OFTEN - 100
    rows = inputs(function, n)
    expected = np.array([function(*call).row for call in zip(*rows, strict=True)])
    assert function.fastest is function.function
    function.compile(wait=True)
    assert function.fastest is not function.function
    assert same(expected, [function(*call).row for call in zip(*rows, strict=True)])
    for alone in (make(), function):  # in the virtual machine, and compiled
        at_once = BatchFunction(alone)
        for many in (n, 3, 1):
            assert same(expected[:many], at_once(*(row[:many] for row in rows)).row)
        assert same(at_once(rows[0]).row[0], make()(rows[0][0]).row)  # the others are left out


def test_a_function_is_compiled_while_it_is_called(cache: Path) -> None:
    function, rows = smooth(), inputs(smooth(), OFTEN)
    expected = [smooth()(*call).row for call in zip(*rows, strict=True)]
    for i in range(OFTEN - 1):
        assert same(function(*(row[i] for row in rows)).row, expected[i])
    assert not cache.exists()
    calls = 0
    while function.fastest is function.function:  # until the test's time is over
        i, calls = calls % OFTEN, calls + 1
        assert same(function(*(row[i] for row in rows)).row, expected[i])
    assert len(list(cache.iterdir())) == 1


@pytest.mark.parametrize("keep", [0, 20, 5000, -1])
def test_a_library_is_kept_and_made_again_if_damaged(keep: int, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None of it is loaded then: half a library can end the process."""
    smooth().compile(wait=True)
    with monkeypatch.context() as without_compiler:
        without_compiler.setattr(subprocess, "Popen", None)
        function = smooth()
        function.compile()
        assert function.fastest is not function.function
    (library,) = cache.iterdir()
    whole = library.read_bytes()
    library.unlink()
    library.write_bytes(whole[:keep])
    function = smooth()
    function.compile()
    assert function.fastest is function.function
    function.compile(wait=True)
    assert function.fastest is not function.function
    assert library.read_bytes()[: -compiled.DIGEST] == whole[: -compiled.DIGEST]


def test_processes_compile_at_once(cache: Path) -> None:
    with ThreadPoolExecutor(3) as pool:
        for said, errors in pool.map(lambda _: run(), range(3)):
            assert (said, errors) == ([[row, "True"] for row in ROWS], "")
    assert [file.suffix for file in cache.iterdir()] == [".so", ".so"]


@pytest.mark.parametrize("what", ["no compiler", "broken compiler", "full disk", "read-only cache"])
def test_without_a_compiler_there_is_one_line_and_the_virtual_machine(what: str, tmp_path: Path, cache: Path) -> None:
    program = tmp_path / "cc"
    program.write_text("#!/bin/sh\necho said; echo 'fatal error: all\n is lost' >&2; exit 1\n")
    program.chmod(0o755)
    environment = {
        "no compiler": {"CC": "no-compiler -m64"},
        "broken compiler": {"CC": str(program)},
        "full disk": {},  # files may have 1000 bytes
        "read-only cache": {"CBF_CLF_QP_CACHE": "/proc/1/nothing"},
    }[what]
    said, errors = run(what.split()[0], **environment)
    assert said == [[row, "False"] for row in ROWS]
    assert errors.startswith("cbf_clf_qp: functions are not compiled, and slower: ")
    assert errors.count("\n") == 1
    assert not cache.exists() or not list(cache.iterdir())


def test_a_forked_process_compiles_its_own(cache: Path) -> None:
    function = smooth()
    function.compile()  # begun
    if not (child := os.fork()):
        function.compile(wait=True)
        os._exit(function.fastest is function.function)
    assert os.waitpid(child, 0)[1] == 0
    function.compile(wait=True)
    assert function.fastest is not function.function


def test_inputs_left_out_are_zero() -> None:
    """Also where an earlier call gave them; and a result is not the next one's."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 2, 2)
    function = NumpyFunction.of("f", {"a": a, "b": b}, {"sum": a + b @ ca.SX([1, 10]), "b": b})
    given, matrix = np.array([1.0, 2.0]), np.array([[3.0, 4.0], [5.0, 6.0]])
    first = function(given, matrix)
    assert function(given).sum == pytest.approx([1, 2])
    assert (first.sum, first.b) == (pytest.approx([44, 67]), pytest.approx(matrix))
    assert function(given, matrix).sum == pytest.approx([44, 67])
    with pytest.raises(ValueError, match="b has 2 numbers; expected 4"):
        function(given, given)
    with pytest.raises(ValueError, match="3 inputs; expected a, b"):
        function(given, matrix, given)
    with pytest.raises(AttributeError, match="no value difference: expected one of sum, b"):
        _ = first.difference


N, M = 5, 4


def drawn(seed: int) -> Estimates:
    rng = np.random.default_rng(seed)
    return Estimates(rng.normal(size=(N, M)), rng.normal(size=N), rng.normal(size=(M, M + 1)))


def test_errors_add_up() -> None:
    first, second, mu = drawn(1), drawn(2), np.array([1.0, -2.0, 3.0, 0.5])
    both = first + second
    assert both.error(mu) == pytest.approx(first.error(mu) + second.error(mu))
    assert both.output_error == pytest.approx(first.output_error + second.output_error)
    unknown = Estimates(second.alpha, second.beta)
    assert (first + unknown).output_error is None
    of_two = Estimates.of_many([first, second]) + Estimates.of_many([second, Estimates.zero(N, M)])
    assert of_two[0].beta == pytest.approx(both.beta)
    assert of_two[1].output_error == pytest.approx(second.output_error)
    assert (of_two + Estimates.of_many([unknown, second])).output_error is None
    for name, value in vars(first + Estimates.zero(N, M)).items():
        assert value == pytest.approx(getattr(first, name))


def test_shapes_fit_together() -> None:
    with pytest.raises(ValueError, match=r"alpha \(4, 5\), beta \(5,\)"):
        Estimates(np.zeros((4, 5)), np.zeros(5))
