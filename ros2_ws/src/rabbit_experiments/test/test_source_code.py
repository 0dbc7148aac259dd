"""A package that imports what its folder has counts with all of it, however it looks the modules up."""

from pathlib import Path

import pytest
from rabbit_experiments.source_code import code_of

READS = (
    "from pkgutil import walk_packages\nFOUND = list(walk_packages(__path__))\n",
    "import os\nFOUND = os.listdir(__path__[0])\n",
)


@pytest.mark.parametrize("text", READS)
def test_a_package_that_reads_its_own_folder_counts_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    package = tmp_path / "own_parts"
    package.mkdir()
    (package / "__init__.py").write_text(text)
    (package / "wind.py").write_text("import numpy\n")
    before = code_of.__wrapped__(frozenset({"own_parts"}))
    assert "numpy" in before
    (package / "wind.py").write_text("import numpy  # changed\n")
    changed = code_of.__wrapped__(frozenset({"own_parts"}))
    (package / "__init__.py").write_text("FOUND = []\n")
    alone = code_of.__wrapped__(frozenset({"own_parts"}))
    assert len({each["own_parts"] for each in (before, changed, alone)}) == 3
    assert "numpy" not in alone
