"""How much memory programs can still get, and how much one has taken."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Iterator
from pathlib import Path

_PROCESS = Path("/proc/self")
# By kind of a control group's file system (version 1 and 2): its limits, what is taken of them, and
# in memory.stat the pages of files, which can be dropped.
_NAMES = {
    "cgroup": (["memory.limit_in_bytes"], "memory.usage_in_bytes", "total_inactive_file"),
    "cgroup2": (["memory.max", "memory.high"], "memory.current", "inactive_file"),
}


def free_memory() -> int | None:
    """Bytes that programs can still get; None where the system doesn't say.

    In a container, or in a unit of systemd's, that is what the least of its limits leaves.
    """
    if sys.platform == "win32":
        return _free_on_windows()
    found = [_entry(Path("/proc/meminfo"), "MemAvailable:"), _free_in_groups()]
    return min((room for room in found if room is not None), default=None)


def taken_by(process: int) -> int:
    """Bytes that a process has in memory; 0 where the system doesn't say."""
    return _entry(Path(f"/proc/{process}/status"), "VmRSS:") or 0


def _entry(path: Path, name: str) -> int | None:
    """A line such as `VmRSS:  123 kB`, in bytes."""
    with contextlib.suppress(OSError, ValueError):
        for line in _text(path).splitlines():
            if line.startswith(name):
                return int(line.split()[1]) << 10
    return None


def _free_in_groups() -> int | None:
    """What is left by the limits of this process's control group and of those it lies in."""
    found: list[int] = []
    try:
        groups = list(_groups())
    except (OSError, ValueError):
        return None
    for kind, folder in groups:
        limits, used, of_files = _NAMES[kind]
        for limit in limits:
            with contextlib.suppress(OSError, ValueError):  # "max" is none
                left = int(_text(folder / limit)) - int(_text(folder / used))
                lines = _text(folder / "memory.stat").splitlines()
                dropped = [x.split()[1] for x in lines if x.startswith(f"{of_files} ")]
                found.append(max(0, left + sum(map(int, dropped))))
    return min(found, default=None)


def _groups() -> Iterator[tuple[str, Path]]:
    """The folders of this process's control groups and of those they lie in, with their kind."""
    own = {}
    for line in _text(_PROCESS / "cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers or "memory" in controllers.split(","):
            own["cgroup" if controllers else "cgroup2"] = Path(path)
    for line in _text(_PROCESS / "mountinfo").splitlines():
        left, _, right = line.partition(" - ")
        (root, mounted), (kind, *_, options) = left.split()[3:5], right.split()
        if kind not in own or (kind == "cgroup" and "memory" not in options.split(",")):
            continue
        folder = top = Path(mounted)
        if own[kind].is_relative_to(root):  # a container may see no more than its own group
            folder = top / own[kind].relative_to(root)
        yield from ((kind, one) for one in (folder, *folder.parents) if one.is_relative_to(top))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="surrogateescape")


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
