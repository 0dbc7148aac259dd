"""`make lock`: write the hashed locks in requirements/ from the `.in` files, for Python 3.11 and 3.12. Needs `uv` on the path.

torch's PyPI build wants CUDA packages, its CPU build does not: torch stands alone in torch.txt and CUDA in torch_cuda.txt,
which the set-up installs only if torch's own metadata asks for it.
"""

import re
import subprocess
from pathlib import Path

REQUIREMENTS = Path(__file__).resolve().parents[1] / "requirements"
OPTIONS = ["--quiet", "--universal", "--python-version", "3.11", "--generate-hashes", "--no-annotate", "--no-header"]
CUDA = re.compile(r"(nvidia|cuda|triton)")
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


def main() -> None:
    """Lock everything, in the order in which one lock binds the next."""
    write("build.txt", compile_lock("build.in"))
    write("python.txt", compile_lock("python.in", "build.txt"))
    write("ros.txt", compile_lock("ros.in", "build.txt", "python.txt"))
    packages = compile_lock("torch.in", "build.txt", "python.txt")
    extra = re.findall(r"--hash=sha256:\w+", (REQUIREMENTS / "torch.in").read_text())  # of builds that PyPI does not list
    torch = next(package for package in packages if package.startswith("torch=="))
    write("torch.txt", [torch.rstrip("\n") + "".join(f" \\\n    {each}" for each in extra) + "\n"])
    write("torch_cuda.txt", [package for package in packages if CUDA.match(package)])


if __name__ == "__main__":
    main()
