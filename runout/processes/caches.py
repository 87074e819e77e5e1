"""Cache folders of compilers and plotting, and whether other users could write into a folder.

Writable folders are set before these libraries are imported.
"""

import logging
import os
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path

from runout.errors import ConfigError

WRITTEN_BY_ALL = "can be written by every user"
LOGGER = logging.getLogger(__name__)


def belongs_to_other(status: os.stat_result) -> bool:
    """Whether a file or folder belongs to another user than this one or root; never for root, nor on systems without owners."""
    return hasattr(os, "geteuid") and os.geteuid() != 0 and status.st_uid not in (os.geteuid(), 0)


def every_user_writes(status: os.stat_result) -> bool:
    """Whether every user of the machine may write a file or folder."""
    return os.name == "posix" and bool(status.st_mode & stat.S_IWOTH)


def fault_of_owner(status: os.stat_result) -> str:
    """Why a file or folder is not safe from other users; empty if it is."""
    return "belongs to another user" if belongs_to_other(status) else WRITTEN_BY_ALL if every_user_writes(status) else ""


@dataclass(frozen=True)
class Cache:
    """One cache: its owner, the environment variable that sets its folder, and the default folder."""

    name: str
    variable: str
    default: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """Present folder of the cache."""
        return Path(os.environ.get(self.variable) or Path(*self.default)).expanduser()

    @property
    def is_stated(self) -> bool:
        """Whether the environment states the folder."""
        return self.variable in os.environ

    def fault(self) -> str:
        """Why others could place code in the folder; empty if they cannot, or if there is none.

        A folder that the environment states may be a link, or that of a colleague.
        """
        if not self.is_stated:
            return _unsafe(self.folder)
        try:
            return WRITTEN_BY_ALL if every_user_writes(self.folder.stat()) else ""
        except OSError:
            return ""


def all_caches() -> tuple[Cache, ...]:
    """Caches of runout and of its libraries for compiling and plotting."""
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    settings = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    compiled = "RUNOUT_CACHE" if os.environ.get("RUNOUT_CACHE") else "NUMBA_CACHE_DIR"
    return (
        Cache("numba (compiled kernels)", compiled, (home, "runout")),
        Cache("warp (compiled kernels)", "WARP_CACHE_PATH", (home, "warp")),
        Cache("matplotlib (fonts)", "MPLCONFIGDIR", (settings, "matplotlib")),
    )


def compiled_code() -> Cache:
    """Cache of the kernels that numba compiles, and of what is known of them."""
    return all_caches()[0]


def prepare() -> None:
    """Replace cache folders that cannot be written, or that are not safe, by temporary ones, here and in child processes.

    Variables that the user has set are not changed. Raises ConfigError if such a variable names a folder that every user can write:
    compiled code of others would run.
    """
    for cache in all_caches():
        fault = cache.fault()
        if cache.is_stated and fault:
            raise ConfigError(f"{cache.variable}={cache.folder}: {fault}; others could place code there, name a folder of your own")
        if fault:
            LOGGER.warning("%s %s; a temporary folder is used for %s", cache.folder, fault, cache.name)
        if not cache.is_stated and (fault or not may_write(cache.folder)):
            os.environ[cache.variable] = str(_temporary() / cache.variable.lower())


def may_write(folder: Path) -> bool:
    """Whether ``folder`` can be written or created; changes nothing."""
    try:
        existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    except OSError:
        return False
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def try_to_write(folder: Path) -> str | None:
    """Reason why a test write to ``folder`` fails; None if it succeeds."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)


def _temporary() -> Path:
    """Temporary folder that all commands of a user share, so that kernels are compiled once."""
    owner = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"runout-{owner}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if not _unsafe(folder):
            return folder
    except OSError:
        pass  # if this fails, each process gets its own folder or reports the error
    return Path(tempfile.mkdtemp(prefix="runout-"))


def _unsafe(folder: Path) -> str:
    """Why a folder that runout has chosen may hold code of others; empty if it is missing or safe."""
    try:
        return "is a link" if folder.is_symlink() else fault_of_owner(folder.stat())
    except OSError:
        return ""
