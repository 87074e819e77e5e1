"""Cores and memory that this process may use: those of the machine or of its container."""

import os
from pathlib import Path

import psutil

CGROUP = Path("/sys/fs/cgroup")  # control groups: version 2 has cpu.max and memory.max here, version 1 a folder for each controller


def core_count() -> int:
    """Number of cores that this process may use, at least 1."""
    process = psutil.Process()
    cores = len(process.cpu_affinity()) if hasattr(process, "cpu_affinity") else os.cpu_count() or 1
    share = _numbers("cpu.max") or _numbers("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")
    if len(share) == 2 and share[0] > 0 and share[1] > 0:
        cores = min(cores, max(1, round(share[0] / share[1])))
    return max(1, cores)


def memory_bytes() -> int:
    """Memory [byte] that all processes on this machine or in this container may use together."""
    total = int(psutil.virtual_memory().total)
    limit = _numbers("memory.max") or _numbers("memory/memory.limit_in_bytes")
    return min(total, int(limit[0])) if limit and limit[0] > 0 else total


def resident_bytes(process: int) -> int:
    """Memory [byte] that a process holds now; 0 if it has ended."""
    try:
        return int(psutil.Process(process).memory_info().rss)
    except psutil.NoSuchProcess:
        return 0


def _numbers(*files: str) -> list[float]:
    """Numbers in files of the control group; empty if a file or a limit is missing."""
    try:
        words = [word for name in files for word in (CGROUP / name).read_text(encoding="ascii").split()]
        return [float(word) for word in words]
    except (OSError, ValueError):  # no such controller, or "max": no limit
        return []
