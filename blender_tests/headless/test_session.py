"""A computation beside a window."""

import os
import sys
import threading

import pytest


@pytest.mark.skipif(sys.platform != "linux", reason="priorities of threads are Linux's")
def test_a_computation_stands_behind_the_window(addon):
    def priority():
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    session = addon("core.background_job")
    before = priority()
    job = session.start()
    try:
        job.begin(lambda progress: priority())
        assert job.result() == min(before + 3, 19)
    finally:
        session.finish()
    assert priority() == before
