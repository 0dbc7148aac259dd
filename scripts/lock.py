"""`make lock`: write the hashed locks in requirements/ from the `.in` files, for Python 3.11 and 3.12. Needs `uv`.

The product needs python.txt; cluster.txt, studies.txt and tests.txt have the rest. torch has locks of its own,
installed after the others: the CPU build, which PyPI does not list, in torch_cpu.txt (by hand), tried first; PyPI's
build in torch.txt; and what that one needs of CUDA in torch_cuda.txt. npm/package-lock.json (`npm install
--package-lock-only` there) and daqp_source.txt of cbf_clf_qp (by hand) have the rest of what the page in the browser
is built of.
"""

import re
import subprocess
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[1] / "requirements"
OPTIONS = ["--quiet", "--universal", "--python-version", "3.11", "--generate-hashes", "--no-annotate", "--no-header"]
CUDA = re.compile(r"(nvidia|cuda|triton)")
TORCH = re.compile(r"torch==")
HEADER = "# Written by `make lock`.\n"


def compile_lock(source: str, *constraints: str) -> list[str]:
    """The locked packages of an `.in` file, each with its hashes."""
    options = [*OPTIONS, *(part for name in constraints for part in ("-c", name))]
    command = ["uv", "pip", "compile", *options, source]
    text = subprocess.run(command, cwd=REQUIREMENTS, check=True, stdout=subprocess.PIPE, text=True).stdout
    return re.findall(r"^\S.*(?:\n .*)*\n", text, flags=re.MULTILINE)


def write(name: str, packages: list[str]) -> None:
    """Write a lock."""
    (REQUIREMENTS / name).write_text(HEADER + "".join(packages))


def added(source: str, *locks: str) -> list[str]:
    """The locked packages of an `.in` file that are in none of the `locks` before it, without torch and CUDA."""
    text = "".join((REQUIREMENTS / lock).read_text() for lock in locks)
    known = {*re.findall(r"^\S+?==", text, flags=re.MULTILINE)}
    packages = compile_lock(source, "build.txt", "torch.in", *locks)
    mine = [package for package in packages if not (TORCH.match(package) or CUDA.match(package))]
    return [package for package in mine if package[: package.index("==") + 2] not in known]


def main() -> None:
    """Lock everything, in the order in which one lock binds the next."""
    write("build.txt", compile_lock("build.in"))
    write("python.txt", added("python.in"))
    write("cluster.txt", added("cluster.in", "python.txt"))
    write("studies.txt", added("studies.in", "python.txt", "cluster.txt"))
    write("tests.txt", added("tests.in", "python.txt", "cluster.txt", "studies.txt"))
    write("ros.txt", compile_lock("ros.in", "build.txt", "python.txt"))
    write("docs.txt", compile_lock("docs.in", "build.txt", "python.txt"))
    write("browser.txt", compile_lock("browser.in", "build.txt", "python.txt"))
    packages = compile_lock("torch.in", "build.txt", "python.txt")
    write("torch.txt", [package for package in packages if TORCH.match(package)])
    write("torch_cuda.txt", [package for package in packages if CUDA.match(package)])


if __name__ == "__main__":
    main()
