"""Tables: CSV with a row for each object of a model, and Markdown."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel
from rabbit_description.atomic_file import replace_table
from rabbit_description.bounded_file import read_text

MOST_BYTES = 100_000_000  # of a table
Model = TypeVar("Model", bound=BaseModel)


def write_rows(path: Path, model: type[BaseModel], rows: Iterable[BaseModel]) -> None:
    """Write a CSV file, at once or not at all, with a column for each field of `model`."""
    replace_table(path, (row.model_dump() for row in rows), model.model_fields)


def read_rows(path: Path, model: type[Model]) -> list[Model]:
    """The rows of such a file; raises `ValueError` where it is none."""
    text = read_text(path, MOST_BYTES)
    try:
        return [model.model_validate(row) for row in csv.DictReader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise ValueError(f"{path}: {error}") from error


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A line for the columns, a rule, and a line for each row."""
    lines = [columns, ("---",) * len(columns), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
