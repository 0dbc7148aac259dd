"""Some hundred hostile files of all kinds; `hostile_files.py` alone reads as many as one likes."""

import subprocess
import sys
from pathlib import Path


def test_hostile_files_are_read_or_refused_within_bounds() -> None:
    """In a process of its own, whose memory is measured."""
    program = Path(__file__).with_name("hostile_files.py")
    words = ("--cases", "400", "--seed", "7")
    done = subprocess.run([sys.executable, program, *words], capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "400 cases, seed 7: 0 wrong" in done.stdout
