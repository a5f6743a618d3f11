"""How threads of the library wait for one another."""

import contextlib
import os
from collections.abc import Iterator

_POLICY = "OMP_WAIT_POLICY"


@contextlib.contextmanager
def giving_way() -> Iterator[None]:
    """While the library is loaded, asks for threads that sleep where they wait.

    OpenMP's own choice is to spin. On a machine that has something else to do, as Blender always
    has, one thread then burns the time slice that the other one needs: measured next to two busy
    processes on two cores, a morph took three times as long. What the user has set stays.
    """
    if _POLICY in os.environ:
        yield
        return
    os.environ[_POLICY] = "passive"
    try:
        yield
    finally:
        del os.environ[_POLICY]
