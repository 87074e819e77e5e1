"""Folders in which compilers and plotting keep what they made: a writable one is found before they are imported."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Cache:
    """One cache: who fills it, the variable that moves it, and where it is otherwise."""

    name: str
    variable: str
    default: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """Where it is now."""
        return Path(os.environ.get(self.variable) or Path(*self.default).expanduser())


def all_caches() -> tuple[Cache, ...]:
    """The caches of runout and of the libraries that it compiles and plots with."""
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    settings = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return (
        Cache("numba (compiled kernels)", "NUMBA_CACHE_DIR", (home, "runout")),
        Cache("warp (compiled kernels)", "WARP_CACHE_PATH", (home, "warp")),
        Cache("matplotlib (fonts)", "MPLCONFIGDIR", (settings, "matplotlib")),
    )


def prepare() -> None:
    """Send a cache whose own folder cannot be written to a temporary one, this process and its children alike.

    A variable that is set is left alone: who set it knows why.
    """
    for cache in all_caches():
        if cache.variable not in os.environ and not may_write(cache.folder):
            os.environ[cache.variable] = str(_temporary() / cache.variable.lower())


def may_write(folder: Path) -> bool:
    """Whether ``folder`` can be written, or made; touches nothing."""
    try:
        existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    except OSError:
        return False
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def try_to_write(folder: Path) -> str | None:
    """Why ``folder`` cannot be written, found by writing; None when it can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)


def _temporary() -> Path:
    """The same folder for every command of a user, so that kernels are compiled once."""
    owner = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"runout-{owner}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if not hasattr(os, "getuid") or folder.stat().st_uid == owner:
            return folder
    except OSError:
        pass  # no folder there either: each process gets its own, and says so if that fails too
    return Path(tempfile.mkdtemp(prefix="runout-"))
