"""For all tests, a package's own and those in tests/: which are thorough, their cache, hypothesis, that some test ran.

`make test` leaves out what `thorough` in pyproject.toml names. `make fuzz` chooses the profile `fuzz`, which runs every
fuzz test much longer.
"""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# of compiled functions, for all workers and runs: not the user's, and kept, for a name says what is in a file;
# `test_compiled.py` has empty ones
os.environ["CBF_CLF_QP_CACHE"] = str(Path(__file__).parent / ".setup" / "compiled")

SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture)

settings.register_profile("default", deadline=None, max_examples=100)
settings.register_profile("fuzz", deadline=None, max_examples=1500, suppress_health_check=SLOW)
settings.load_profile("default")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as of a shell's background job; what tests start inherits it
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`thorough`, in pyproject.toml."""
    parser.addini("thorough", "how the names of thorough tests begin; behind a !, those of exceptions", "linelist")


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the thorough ones."""
    names = config.getini("thorough")
    thorough, others = tuple(names), tuple(name[1:] for name in names if name.startswith("!"))
    for item in items:
        if item.nodeid.startswith(thorough) and not item.nodeid.startswith(others):
            item.add_marker("thorough")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Turn a run in which no test passed or failed into an error: `colcon test` takes it for success."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter and not any(reporter.stats.get(outcome) for outcome in ("passed", "failed", "error")):
        session.exitstatus = pytest.ExitCode.USAGE_ERROR
