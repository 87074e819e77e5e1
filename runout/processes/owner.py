"""Whether other users of the machine could place code or results in a file or folder."""

import os
import stat

WRITTEN_BY_ALL = "can be written by every user"


def belongs_to_other(status: os.stat_result) -> bool:
    """Whether a file or folder belongs to another user than this one or root; never for root, nor on systems without owners."""
    return hasattr(os, "geteuid") and os.geteuid() != 0 and status.st_uid not in (os.geteuid(), 0)


def every_user_writes(status: os.stat_result) -> bool:
    """Whether every user of the machine may write a file or folder."""
    return os.name == "posix" and bool(status.st_mode & stat.S_IWOTH)


def fault_of_owner(status: os.stat_result) -> str:
    """Why a file or folder is not safe from other users; empty if it is."""
    return "belongs to another user" if belongs_to_other(status) else WRITTEN_BY_ALL if every_user_writes(status) else ""
