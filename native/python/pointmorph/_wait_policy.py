"""How the library's threads wait for one another."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator

_VARIABLE = "OMP_WAIT_POLICY"


@contextlib.contextmanager
def passive_wait_policy() -> Iterator[None]:
    """Lets OpenMP threads sleep while they wait. OpenMP reads this when the library is loaded.

    By default they spin. On a machine that is busy otherwise, as with Blender it always is, a
    spinning thread uses up the time slice that the thread it waits for needs: beside two busy
    processes on two cores, a morph took three times as long. A policy set by the user is kept.
    """
    if _VARIABLE in os.environ:
        yield
        return
    os.environ[_VARIABLE] = "passive"
    _tell_runtime("passive")
    try:
        yield
    finally:
        del os.environ[_VARIABLE]
        _tell_runtime("")


def _tell_runtime(value: str) -> None:
    """On Windows the library's C runtime isn't Python's, and has a copy of the environment."""
    if sys.platform == "win32":
        ctypes.CDLL("msvcrt")._putenv(f"{_VARIABLE}={value}".encode())
