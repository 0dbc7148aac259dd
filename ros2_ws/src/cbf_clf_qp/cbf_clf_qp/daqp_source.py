"""DAQP's C source, for programs without CasADi. CasADi's wheel has only headers and a library for one platform.

pip downloads the source package of `daqp` once and checks its hash. The package then lies in the cache of `compiled`.
"""

import re
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from cbf_clf_qp.compiled import cache

LOCK = Path(__file__).with_suffix(".txt")
PATIENCE = 300  # s, for pip


class SourceError(OSError):
    """The source cannot be had, and why."""


def unpack_daqp(folder: Path) -> Path:
    """Unpack the source into a folder. Returns its `csrc`, with `include` and `src`; the licence lies beside `csrc`.

    Raises:
        SourceError: the package index does not answer, or has another file.
    """
    package = source_package()
    shutil.unpack_archive(package, folder)
    return folder / package.name.removesuffix(".tar.gz") / "csrc"


def source_package() -> Path:
    """The package in the cache."""
    text = LOCK.read_text()
    ((version, digest),) = re.findall(r"^daqp==(\S+) --hash=sha256:(\S+)", text, re.MULTILINE)
    path = cache() / f"daqp-{version}.tar.gz"
    if path.is_file() and sha256(path.read_bytes()).hexdigest() == digest:
        return path
    options = ["--no-binary", "daqp", "--no-deps", "--require-hashes", "--no-input", "-r", str(LOCK)]
    command = [sys.executable, "-m", "pip", "download", *options]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=path.parent) as folder:
            done = subprocess.run(command, cwd=folder, timeout=PATIENCE, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SourceError((re.findall("ERROR: (.*)", done.stderr) or ["pip cannot get it"])[-1])
            Path(folder, path.name).replace(path)
    except subprocess.TimeoutExpired as error:
        raise SourceError(f"daqp {version}: pip takes more than {PATIENCE} s") from error
    except OSError as error:
        raise SourceError(f"daqp {version}: {error}") from error
    return path
