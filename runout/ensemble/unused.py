"""Files of members that the present settings do not use: they are kept for settings that come back, and removed on demand."""

import re
from collections.abc import Iterable
from pathlib import Path

from runout.ensemble.member import Member, members_folder
from runout.ensemble.written import Written
from runout.io.lock import exclusive

OWN_FILE = re.compile(r"([0-9a-f]{16}|\d{4,})\.(nc|failed\.json|([0-9a-f]{16}\.)?checkpoint\.npz)")  # numbers: of earlier versions


def unused_files(results: Path, members: Iterable[Member]) -> list[Path]:
    """Files of other members than ``members`` in a results folder, in the order of their names; no files of other origin."""
    folder, used = members_folder(results), {member.name for member in members}
    if not folder.is_dir():
        return []
    others = (path for path in folder.iterdir() if path.name.partition(".")[0] not in used)
    return sorted(path for path in others if OWN_FILE.fullmatch(path.name) and path.is_file())


def remove_unused(results: Path, members: Iterable[Member]) -> tuple[int, int]:
    """Remove the files of :func:`unused_files`; returns their number and size [byte].

    Raises StorageError if a run works in the folder, or a file cannot be removed.
    """
    folder = members_folder(results)
    if not folder.is_dir():
        return 0, 0
    with exclusive(folder):
        files, written = unused_files(results, members), Written(results)
        size = sum(path.stat().st_size for path in files)
        for path in files:
            written.forget(path)
        if files:
            written.save()
    return len(files), size
