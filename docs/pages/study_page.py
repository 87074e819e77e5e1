"""Page of a study: a summary in Markdown, with its full tables as CSV and its figure as files beside it."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np

from runout.io.atomic import whole_file, write_text
from runout.studies.work_precision import markdown

__all__ = ["StudyPage", "as_csv", "as_png", "download", "markdown"]
TABLES = "tables"  # folder of the CSV files, beside the page


@dataclass(frozen=True)
class StudyPage:
    """Content of the page of a study.

    Attributes
    ----------
    name : str
        File name of the page without its ending.
    text : str
        The page, in Markdown.
    tables : mapping of str to str
        Text of each CSV file, by its file name in the folder :data:`TABLES`.
    pictures : mapping of str to bytes
        PNG of each figure, by its path from the page.
    """

    name: str
    text: str
    tables: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[str, bytes] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write figures, tables and page to a folder; returns the path of the page.

        Raises
        ------
        StorageError
            If the folder cannot be written.
        """
        for name, picture in self.pictures.items():
            with whole_file(folder / name) as temporary:
                temporary.write_bytes(picture)
        for name, table in self.tables.items():
            write_text(table, folder / TABLES / name)
        return write_text(self.text, folder / f"{self.name}.md")


def as_csv(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table as CSV; None is an empty cell."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return text.getvalue()


def download(name: str, what: str) -> str:
    """Link in Markdown that downloads a CSV file."""
    return f"{{download}}`{what} <{TABLES}/{name}>`"


def as_png(figure: Any) -> bytes:
    """PNG of a figure of matplotlib."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=100)
    return picture.getvalue()


def draw_outline(axes: Any, outline: list[list[list[float]]], **style: Any) -> None:
    """Draw rings; only the first has the label."""
    label = style.pop("label", None)
    for number, ring in enumerate(outline):
        x, y = np.array(ring).T
        axes.plot(x, y, label=label if number == 0 else None, **style)


def along(values: Sequence[float | None]) -> np.ndarray:
    """Numbers of a record; None is NaN."""
    return np.array([np.nan if v is None else v for v in values], float)
