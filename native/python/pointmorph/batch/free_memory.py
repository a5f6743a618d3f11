"""How much memory programs can still get, and how much one has taken."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from pathlib import Path

_GROUP = Path("/sys/fs/cgroup")


def free_memory() -> int | None:
    """Bytes that programs can still get; None where the system doesn't say.

    In a container, that is what its limit leaves.
    """
    if sys.platform == "win32":
        return _free_on_windows()
    found = [room for room in (_free_on_machine(), _free_in_group()) if room is not None]
    return min(found, default=None)


def taken_by(process: int) -> int:
    """Bytes that a process has in memory; 0 where the system doesn't say."""
    return _entry(Path(f"/proc/{process}/status"), "VmRSS:") or 0


def _free_on_machine() -> int | None:
    return _entry(Path("/proc/meminfo"), "MemAvailable:")


def _entry(path: Path, name: str) -> int | None:
    """A line such as `VmRSS:  123 kB`, in bytes."""
    with contextlib.suppress(OSError, ValueError):
        for line in path.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith(name):
                return int(line.split()[1]) << 10
    return None


def _free_in_group() -> int | None:
    """What the control group's limit leaves; pages of files can be dropped."""
    with contextlib.suppress(OSError, ValueError):
        limit = (_GROUP / "memory.max").read_text(encoding="ascii").strip()
        if limit != "max":
            used = int((_GROUP / "memory.current").read_text(encoding="ascii"))
            lines = (_GROUP / "memory.stat").read_text(encoding="ascii").splitlines()
            of_files = next((int(x.split()[1]) for x in lines if x.startswith("inactive_file ")), 0)
            return max(0, int(limit) - used + of_files)
    return None


def _free_on_windows() -> int | None:
    class Status(ctypes.Structure):
        _fields_ = (
            ("length", ctypes.c_uint32),
            ("load", ctypes.c_uint32),
            *((name, ctypes.c_uint64) for name in (
                "total", "free", "total_page", "free_page", "total_virtual", "free_virtual",
                "free_extended",
            )),
        )  # fmt: skip

    status = Status(length=ctypes.sizeof(Status))
    if ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)):  # type: ignore[attr-defined,unused-ignore]
        return int(status.free)
    return None
