"""Cache folders of compilers and plotting. Writable folders are set before these libraries are imported."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path


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
    """Replace cache folders that cannot be written by temporary ones, for this process and its children.

    Variables that the user has set are not changed.
    """
    for cache in all_caches():
        if cache.variable not in os.environ and not may_write(cache.folder):
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
        if not hasattr(os, "getuid") or folder.stat().st_uid == owner:
            return folder
    except OSError:
        pass  # if this fails, each process gets its own folder or reports the error
    return Path(tempfile.mkdtemp(prefix="runout-"))
