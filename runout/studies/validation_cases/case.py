"""A case of the validation, and the files that it needs."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runout.config.fetch import DATA_FOLDER, fetch
from runout.config.remote import RemoteFile
from runout.errors import InputError


@dataclass(frozen=True)
class ValidationCase:
    """One case: ``measure(full)`` runs it, coarse for CI or at the sizes of the documentation."""

    name: str  # name for the command and of the page
    title: str
    measure: Callable[[bool], dict[str, Any]]  # results, ready for JSON


def data_folder(name: str, source: str) -> Path:
    """Folder below RUNOUT_DATA; ``source`` says where its files come from. Raises InputError if it is not there."""
    root = os.environ.get(DATA_FOLDER)
    folder = Path(root).expanduser() / name if root else None
    if folder is None or not folder.is_dir():
        place = folder or f"${DATA_FOLDER}/{name}"
        remedy = f"get the files from {source} and set {DATA_FOLDER} to the folder that holds {name}/"
        raise InputError(f"{place}: is not there; {remedy}")
    return folder


def public_file(url: str, path: str, size: int, sha256: str) -> Path:
    """Path of a checked copy of a public file, below RUNOUT_DATA or in the user's cache; see :func:`runout.config.fetch.fetch`."""
    return fetch(RemoteFile(url=url, path=path, size=size, sha256=sha256))


def on_all_processors(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    """Results of a function of a module for each of many jobs, in their order, in one process a processor."""
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as workers:
        return list(workers.map(function, jobs))
