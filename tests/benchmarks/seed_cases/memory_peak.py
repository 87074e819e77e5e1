"""Largest memory of this process and of a card."""

import resource
import subprocess
import sys
from pathlib import Path

PROCESS = Path("/proc/self")


def forget_host_peak() -> None:
    """Set the largest memory of this process back to what it holds now, where the system can."""
    try:
        (PROCESS / "clear_refs").write_text("5")
    except OSError:
        return


def host_peak() -> float:
    """Largest resident memory [byte] of this process since :func:`forget_host_peak`."""
    try:
        lines = (PROCESS / "status").read_text().splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * (1 if sys.platform == "darwin" else 1024)


def card_used() -> float | None:
    """Memory [byte] in use on the first card by its driver, with context and kernels; None where the driver's tool is missing."""
    answer = _asked("memory.used", "nounits")
    return 2.0**20 * float(answer) if answer else None


def card_name() -> str | None:
    """Name of the first card; None where the driver's tool is missing."""
    return _asked("name") or None


def _asked(what: str, *formats: str) -> str:
    try:
        asked = ["nvidia-smi", f"--query-gpu={what}", f"--format={','.join(('csv', 'noheader', *formats))}"]
        return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=20).stdout.splitlines()[0].strip()
    except (OSError, subprocess.SubprocessError, IndexError):
        return ""
