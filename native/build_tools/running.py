"""Saying what is done, running commands, and remembering what was made from what."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from . import paths

_used = threading.local()
_groups: set[int] = set()
_stopped = threading.Event()


class SetupError(Exception):
    """Something went wrong that the user can mend; the message says how."""


def say(text: str) -> None:
    print(text, flush=True)


@contextmanager
def step(title: str) -> Iterator[None]:
    """Says what is being done, and how long it took where that was worth a wait."""
    say(f"  {title} ...")
    start = time.monotonic()
    yield
    if (seconds := time.monotonic() - start) >= 1:
        say(f"  {title}: {seconds:.0f} s")


def child_environment(**more: str) -> dict[str, str]:
    """The environment of every command: .venv first, and nothing of the user's own Python."""
    ours = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    ours["PATH"] = os.pathsep.join([str(paths.VENV / "bin"), os.environ.get("PATH", os.defpath)])
    ours["PYTHONNOUSERSITE"] = "1"
    ours.setdefault("OMP_WAIT_POLICY", "passive")  # as the package; suites run side by side
    prefixes = [str(paths.SITE_PACKAGES / "cmeel.prefix"), os.environ.get("CMAKE_PREFIX_PATH", "")]
    ours["CMAKE_PREFIX_PATH"] = os.pathsep.join(filter(None, prefixes))
    return ours | more


def run(
    log: str,
    *command: str | Path,
    environment: dict[str, str] | None = None,
    timeout: float | None = None,
    check: bool = True,
) -> int:
    """Runs a command, appends its output to build/logs/<log>.log, returns the exit status.

    The status is negative after a signal. With `check`, a failure raises and shows the log's end.
    What the command has started ends with it where it is stopped, and with this program.
    """
    if _stopped.is_set():
        raise SetupError("Interrupted.")
    paths.LOGS.mkdir(parents=True, exist_ok=True)
    path = paths.LOGS / f"{log}.log"
    words = [str(word) for word in command]
    with path.open("a") as output:
        print("$", *words, file=output, flush=True)
        try:
            process = subprocess.Popen(
                words,
                cwd=paths.ROOT,
                env=environment or child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                # sudo asks for a password, which only the terminal's own group may read.
                process_group=None if words[0] == "sudo" else 0,
            )
        except OSError as error:
            raise SetupError(f"{words[0]} can't be run: {error.strerror}.") from error
        with _guarded(process):
            status, in_time = _wait(process, timeout)
        if not in_time:
            print(f"Stopped after {timeout:.0f} s.", file=output)
    if check and status != 0:
        raise SetupError(f"{words[0]} failed with status {status}:\n{end_of(log)}")
    return status


@contextmanager
def _guarded(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """A process, and what it has started, ends with this program, even if that is killed."""
    group = os.getpgid(process.pid)
    if group == os.getpgrp():
        yield
        return
    _groups.add(group)
    if _stopped.is_set():  # stop_all() may have looked just before
        _kill(group)
    try:
        # Its input ends when this program does; a line tells it that all is well.
        words = ("sh", "-c", f"read line || kill -KILL -{group}")
        guard = subprocess.Popen(
            words, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, process_group=0
        )
    except OSError:
        _kill(group)
        _groups.discard(group)
        raise
    try:
        yield
    finally:
        _groups.discard(group)
        guard.communicate(b"\n")


def stop_all() -> None:
    """Ends all commands that run, with what they have started; no other can begin."""
    _stopped.set()
    for group in list(_groups):
        _kill(group)


def _kill(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def _wait(process: subprocess.Popen[bytes], timeout: float | None) -> tuple[int, bool]:
    """The status of a process, and whether it ended by itself; notes what it used."""
    stopped = threading.Event()

    def kill() -> None:
        if process.pid in _groups:
            _kill(process.pid)
        else:
            process.kill()

    def stop() -> None:
        stopped.set()
        kill()

    watch = threading.Timer(timeout or 0, stop)
    if timeout is not None:
        watch.start()
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        kill()
        process.wait()
        raise
    finally:
        watch.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    used = usage.ru_utime + usage.ru_stime
    _used.seconds = processor_seconds() + used
    return process.returncode, not stopped.is_set()


def processor_seconds() -> float:
    """What the commands that this thread has run have used so far."""
    return float(getattr(_used, "seconds", 0.0))


def end_of(log: str) -> str:
    path = paths.LOGS / f"{log}.log"
    lines = path.read_text(errors="replace").splitlines()[-25:]
    return "\n".join(["    " + line for line in lines] + [f"(All of it: {path})"])


def digest(*things: str | Path) -> str:
    """A hash of texts, and of the contents of files and of whole folders."""
    hasher = hashlib.sha256()
    for thing in things:
        if isinstance(thing, str):
            hasher.update(thing.encode() + b"\0")
            continue
        for path in sorted(thing.rglob("*")) if thing.is_dir() else [thing]:
            if path.is_file() and "__pycache__" not in path.parts:
                hasher.update(
                    str(path.relative_to(paths.ROOT)).encode() + b"\0" + path.read_bytes()
                )
    return hasher.hexdigest()


def is_fresh(stamp: Path, key: str) -> bool:
    """Whether what `stamp` lies beside was made from what `key` is the digest of."""
    return stamp.is_file() and stamp.read_text() == key


def show(*command: str | Path, environment: dict[str, str] | None = None) -> int:
    """Runs a command whose output is for the user to see; returns the exit status."""
    environment = environment or child_environment()
    return subprocess.run(command, env=environment, check=False, cwd=paths.ROOT).returncode
