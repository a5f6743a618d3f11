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
from pathlib import Path

from pointmorph import files
from pointmorph.batch_jobs import LOG, RECORD, REPORT, PairJob
from pointmorph.errors import FileError
from pointmorph.frame_records import file_checksum

DONE, KEPT, FAILED, PENDING = "done", "kept", "failed", "pending"

_POLL = 0.05  # seconds
_PATIENCE = 20.0  # seconds for a process to end by itself
# Memory of a morph until one has been measured: at the least, and for each byte of its files.
_LEAST, _PER_BYTE = 300 << 20, 400.0
_SPARE = 0.9  # share of the memory that is there


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
    commands: list[list[str]]
    memory: int
    """bytes that it is expected to take"""
    identity: str
    started: float = field(default_factory=time.monotonic)
    process: subprocess.Popen[bytes] | None = None


def free_memory() -> int | None:
    """Bytes that programs can still get; None where the system doesn't say."""
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) << 10
    return None


def put_on_record(job: PairJob, identity: str) -> None:
    """Records that the map of a pair is found. Raises FileError."""
    record = {"of": identity, "morph": file_checksum(job.morph_file)}
    files.write_bytes(job.folder / RECORD, (json.dumps(record) + "\n").encode())


class BatchRun:
    """Runs the pairs of a batch, each in a process of its own, and keeps what is done.

    Parameters
    ----------
    jobs : sequence of PairJob
    most : int, optional
        Processes side by side; otherwise as many as there are cores and memory for.
    with_frames : bool
        Also make the frames.
    """

    def __init__(
        self, jobs: Sequence[PairJob], most: int | None = None, *, with_frames: bool = True
    ) -> None:
        self.outcomes = [PairOutcome(job) for job in jobs]
        self._cores = os.cpu_count() or 1
        self._most = most or self._cores
        self._with_frames = with_frames
        self._per_byte = _PER_BYTE
        self._measured = False
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
                started = bool(waiting) and self._start(waiting[0], running)
                if started:
                    waiting.pop(0)
                for one in [r for r in running if self._advance(r)]:
                    running.remove(one)
                    if self._is_short_of_memory(one) and one.outcome not in self._alone:
                        self._alone.append(one.outcome)
                        waiting.append(one.outcome)
                    else:
                        tell(one.outcome)
                if not started:
                    time.sleep(_POLL)
        finally:
            _end([one.process for one in running if one.process is not None])

    def _start(self, outcome: PairOutcome, running: list[_Running]) -> bool:
        """Whether a pair could be started: now, or at once when nothing else runs."""
        needed = self._expected(outcome.job)
        if running:
            if any(one in self._alone for one in (outcome, *(r.outcome for r in running))):
                return False
            free = free_memory()
            # What runs may not have taken yet what it is going to.
            promised = sum(one.memory for one in running if time.monotonic() - one.started < 30.0)
            fits = free is None or needed + promised <= _SPARE * free
            if len(running) >= self._most or not fits or not self._measured:
                return False
        running.append(self._prepared(outcome, needed))
        return True

    def _prepared(self, outcome: PairOutcome, memory: int) -> _Running:
        job = outcome.job
        commands: list[list[str]] = []
        identity = ""
        try:
            files.make_folder(job.folder)
            (job.folder / LOG).write_bytes(b"")
            identity = job.identity()
            if not job.is_matched():
                (job.folder / RECORD).unlink(missing_ok=True)
                commands.append(job.morph_words())
            if self._with_frames and job.frames:
                commands.append(job.frames_words())
            outcome.state = DONE if ["morph"] in [words[:1] for words in commands] else KEPT
        except (FileError, OSError) as error:
            outcome.state, outcome.message = FAILED, str(error)
            commands = []
        return _Running(outcome, commands, memory, identity)

    def _advance(self, one: _Running) -> bool:
        """Sees to a pair's commands, one after the other; whether it has ended."""
        process = one.process
        if process is None:
            if one.outcome.state == FAILED or not one.commands:
                return self._ended(one)
            one.process = self._popen(one)
            return False
        if process.poll() is None:
            return False
        command = one.commands.pop(0)
        one.process = None
        if process.returncode != 0:
            one.commands.clear()
            one.outcome.state = FAILED
            one.outcome.message = _last_words(one.outcome.job, process.returncode)
        elif command[0] == "morph":
            self._learn(one)
        return False

    def _ended(self, one: _Running) -> bool:
        one.outcome.seconds = time.monotonic() - one.started
        self._measured = True
        return True

    @staticmethod
    def _is_short_of_memory(one: _Running) -> bool:
        return one.outcome.state == FAILED and any(
            words in one.outcome.message for words in ("Out of memory", "memory ran out")
        )

    def _popen(self, one: _Running) -> subprocess.Popen[bytes]:
        share = max(1, self._cores // min(self._most, len(self.outcomes)))
        environment = {**os.environ}
        environment.setdefault("OMP_NUM_THREADS", str(share))
        command = [sys.executable, "-m", "pointmorph", *one.commands[0]]
        with (one.outcome.job.folder / LOG).open("ab") as log:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,  # Ctrl-C comes from here alone
            )

    def _learn(self, one: _Running) -> None:
        """Puts on record that the map is found, and how much memory that took."""
        job = one.outcome.job
        try:
            put_on_record(job, one.identity)
            peak = json.loads((job.folder / REPORT).read_text(encoding="utf-8"))
            taken = int(peak["peak_memory_bytes"]) - _LEAST
        except (OSError, ValueError, KeyError, FileError) as error:
            one.outcome.state, one.outcome.message = FAILED, str(error)
            return
        rate = taken / max(_bytes(job), 1)
        self._per_byte = max(rate, self._per_byte if self._measured else 0.0)
        self._measured = True

    def _expected(self, job: PairJob) -> int:
        return _LEAST + int(self._per_byte * _bytes(job))


def _bytes(job: PairJob) -> int:
    return sum(p.stat().st_size for p in (job.source, job.target) if p.is_file())


def _last_words(job: PairJob, status: int) -> str:
    """What a process that failed said last."""
    text = (job.folder / LOG).read_text(encoding="utf-8", errors="replace")
    said = [line for line in text.splitlines() if line.startswith("pointmorph: ")]
    said = [line for line in said if not line.startswith("pointmorph: warning")]
    if said:
        return said[-1].removeprefix("pointmorph: ")
    if status < 0:
        return f"The process was killed by signal {-status}: perhaps memory ran out."
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
