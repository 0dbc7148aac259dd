"""For all tests, a package's own and those in tests/: profiles of hypothesis, and an error where no test ran.

`make fuzz` chooses the profile `fuzz`, which runs every fuzz test much longer.
"""

import signal

import pytest
from hypothesis import HealthCheck, settings

SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture)

settings.register_profile("default", deadline=None, max_examples=100)
settings.register_profile("fuzz", deadline=None, max_examples=1500, suppress_health_check=SLOW)
settings.load_profile("default")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as of a shell's background job; what tests start inherits it
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Turn a run in which no test passed or failed into an error: `colcon test` takes it for success."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter and not any(reporter.stats.get(outcome) for outcome in ("passed", "failed", "error")):
        session.exitstatus = pytest.ExitCode.USAGE_ERROR
