"""The process ends at its deadline, whoever holds the interpreter's lock."""

import subprocess
import sys

import pytest

HANGS = """
import ctypes
from rabbit_common.deadline import end_within
print("said", end="")
end_within(1, {code})
ctypes.PyDLL(None).pause()  # keeps the lock
"""


@pytest.mark.parametrize("code", [0, 2])
def test_a_process_that_hangs_ends_with_its_code_and_what_it_said(code: int) -> None:
    command = [sys.executable, "-c", HANGS.format(code=code)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, "said", "")
