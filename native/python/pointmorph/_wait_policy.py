"""How the library's threads wait for one another."""

import contextlib
import os
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
    try:
        yield
    finally:
        del os.environ[_VARIABLE]
