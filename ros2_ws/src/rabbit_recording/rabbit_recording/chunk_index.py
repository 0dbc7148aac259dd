"""The index of an MCAP file's chunks, kept on disk until the file is closed: a long recording takes no more memory."""

from array import array
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile


class ChunkIndex(list[BytesIO]):
    """Stands in for `McapWriter.chunks`, of which only `append`, `len` and iteration are used."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115, it has no name and is gone with this object
        self._sizes = array("I")

    def append(self, record: BytesIO) -> None:
        """Keep one record."""
        self._sizes.append(self._file.write(record.getbuffer()))

    def __len__(self) -> int:
        """Records so far."""
        return len(self._sizes)

    def __iter__(self) -> Iterator[BytesIO]:
        """Records in their order, each positioned at its end, as they were."""
        self._file.seek(0)
        for size in self._sizes:
            record = BytesIO()
            record.write(self._file.read(size))
            yield record
        self._file.seek(0, 2)
