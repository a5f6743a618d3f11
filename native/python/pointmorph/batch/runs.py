"""Running many morphs side by side, as many as there is memory for."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pointmorph.base.errors import FileError
from pointmorph.batch.free_memory import free_memory, taken_by
from pointmorph.batch.jobs import LOG, REPORT, PairJob
from pointmorph.batch.tasks import FRAMES_STEP, MAP_STEP, put_on_record, steps_to_do
from pointmorph.storage import files

DONE, KEPT, FAILED, PENDING = "done", "kept", "failed", "pending"

_POLL = 0.05  # seconds
_PATIENCE = 20.0  # seconds for a process to end by itself
# Memory of a morph until one has been measured: at the least, and for each byte of its files.
_LEAST, _PER_BYTE = 300 << 20, 400.0
_SPARE = 0.9  # share of the free memory that is given to morphs


@dataclass
class PairOutcome:
    """What became of a pair."""

    job: PairJob
    state: str = PENDING
    """done, kept (from an earlier run), failed or pending"""
    seconds: float = 0.0
    message: str = ""
    """of a pair that failed: what went wrong"""


@dataclass
class _Running:
    outcome: PairOutcome
    steps: list[str]
    memory: int
    """bytes that it is expected to take"""
    identity: str = ""
    started: float = field(default_factory=time.monotonic)
    process: subprocess.Popen[bytes] | None = None

    def to_come(self) -> int:
        """Bytes that it hasn't taken yet."""
        return max(0, self.memory - (taken_by(self.process.pid) if self.process else 0))


class BatchRun:
    """Runs the pairs of a batch, each in a process of its own, and keeps what is done.

    The first pair runs alone: from what it takes, the memory that others need is estimated.

    Parameters
    ----------
    jobs : sequence of PairJob
    most : int, optional
        Processes side by side; otherwise as many as there are cores. Never more than there is
        memory for.
    with_frames : bool
        Also make the frames.
    """

    def __init__(
        self, jobs: Sequence[PairJob], most: int | None = None, *, with_frames: bool = True
    ) -> None:
        self.outcomes = [PairOutcome(job) for job in jobs]
        self._cores = _cores()
        self._most = most or self._cores
        self._with_frames = with_frames
        self._per_byte = _PER_BYTE
        self._is_measured = False
        self._alone: list[PairOutcome] = []
        """Pairs that ran out of memory beside others."""

    def run(self, tell: Callable[[PairOutcome], None]) -> None:
        """Runs all. A pair that fails doesn't keep others from being run.

        Parameters
        ----------
        tell : callable
            Called with each pair that has ended.
        """
        waiting = list(self.outcomes)
        running: list[_Running] = []
        try:
            while waiting or running:
                needed = self._expected(waiting[0].job) if waiting else 0
                starts = bool(waiting) and self._may_start(waiting[0], needed, running)
                if starts:
                    running.append(self._prepared(waiting.pop(0), needed))
                for one in [r for r in running if self._has_ended(r)]:
                    running.remove(one)
                    if _is_short_of_memory(one.outcome) and one.outcome not in self._alone:
                        self._alone.append(one.outcome)
                        waiting.append(one.outcome)
                    else:
                        tell(one.outcome)
                if not starts:
                    time.sleep(_POLL)
        finally:
            _end([one.process for one in running if one.process is not None])

    def _may_start(self, outcome: PairOutcome, needed: int, running: Sequence[_Running]) -> bool:
        """Whether a pair can run beside what runs; alone, any can."""
        if not running:
            return True
        if not self._is_measured or len(running) >= self._most:
            return False
        if any(one in self._alone for one in (outcome, *(r.outcome for r in running))):
            return False
        free = free_memory()
        return free is None or needed + sum(r.to_come() for r in running) <= _SPARE * free

    def _prepared(self, outcome: PairOutcome, memory: int) -> _Running:
        """A pair with the steps that it still needs."""
        job = outcome.job
        one = _Running(outcome, [], memory)
        outcome.state, outcome.message = KEPT, ""
        try:
            files.make_folder(job.folder)
            (job.folder / LOG).write_bytes(b"")
            one.identity = job.identity()
            one.steps = steps_to_do(job, with_frames=self._with_frames)
            if one.steps:
                outcome.state = DONE
        except (FileError, OSError) as error:
            outcome.state, outcome.message = FAILED, str(error)
        return one

    def _has_ended(self, one: _Running) -> bool:
        """Sees to a pair's steps, one after the other; whether the last one has ended."""
        process = one.process
        if process is None:
            if one.steps:
                one.process = self._process(one)
                return False
            one.outcome.seconds = time.monotonic() - one.started
            self._is_measured = True
            return True
        if process.poll() is None:
            return False
        step = one.steps.pop(0)
        one.process = None
        if process.returncode != 0:
            one.steps.clear()
            one.outcome.state = FAILED
            one.outcome.message = _last_words(one.outcome.job, process.returncode)
        elif step == MAP_STEP:
            self._learn(one)
        return False

    def _process(self, one: _Running) -> subprocess.Popen[bytes]:
        job = one.outcome.job
        words = job.frames_words() if one.steps[0] == FRAMES_STEP else job.morph_words()
        share = max(1, self._cores // min(self._most, len(self.outcomes)))
        environment = {**os.environ}
        environment.setdefault("OMP_NUM_THREADS", str(share))
        with (job.folder / LOG).open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "pointmorph", *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,  # a Ctrl-C is passed on by this process alone
            )

    def _learn(self, one: _Running) -> None:
        """Puts on record that the map is found, and how much memory that took."""
        job = one.outcome.job
        try:
            put_on_record(job, one.identity)
            report = json.loads((job.folder / REPORT).read_text(encoding="utf-8"))
            taken = int(report["peak_memory_bytes"]) - _LEAST
        except (OSError, ValueError, KeyError, TypeError, FileError) as error:
            one.steps.clear()
            one.outcome.state, one.outcome.message = FAILED, str(error)
            return
        rate = max(taken, 0) / max(job.bytes(), 1)
        self._per_byte = max(rate, self._per_byte if self._is_measured else 0.0)
        self._is_measured = True

    def _expected(self, job: PairJob) -> int:
        return _LEAST + int(self._per_byte * job.bytes())


def _cores() -> int:
    """Those that this process may run on."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _is_short_of_memory(outcome: PairOutcome) -> bool:
    words = ("Out of memory", "memory ran out")
    return outcome.state == FAILED and any(w in outcome.message for w in words)


def _last_words(job: PairJob, status: int) -> str:
    """What a process that failed said last."""
    text = (job.folder / LOG).read_text(encoding="utf-8", errors="replace")
    said = [line for line in text.splitlines() if line.startswith("pointmorph: ")]
    said = [line for line in said if not line.startswith("pointmorph: warning")]
    if said:
        return said[-1].removeprefix("pointmorph: ")
    if status < 0:
        return f"The process was killed by signal {-status}, perhaps because memory ran out."
    return f"The process ended with status {status}; see {job.folder / LOG}."


def _end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Asks processes to end, and waits until they have."""
    for process in processes:
        process.terminate()
    deadline = time.monotonic() + _PATIENCE
    for process in processes:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(max(0.1, deadline - time.monotonic()))
        process.kill()
        process.wait()
