"""`colcon test` fails where no test ran: colcon itself takes pytest's "no tests collected" for success."""

import pytest


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Turn a run in which no test passed or failed into an error."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter and not any(reporter.stats.get(outcome) for outcome in ("passed", "failed", "error")):
        session.exitstatus = pytest.ExitCode.USAGE_ERROR
