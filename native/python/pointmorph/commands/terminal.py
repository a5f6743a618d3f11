"""What all commands share: progress bars, exit statuses, and an orderly end."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import sys
import textwrap
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, TextIO

from pointmorph.base.stages import Progress, stage_label

FAILED, WRONG_CALL, INCOMPLETE, INTERRUPTED, TERMINATED = 1, 2, 3, 130, 143


_asked_to_end = threading.Event()


class Terminated(KeyboardInterrupt):
    """Somebody ended the process: a job's engine, for instance."""


@contextlib.contextmanager
def orderly_end() -> Iterator[None]:
    """Meanwhile, SIGTERM ends what runs as Ctrl-C does, so that nothing is left half-written."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    _asked_to_end.clear()

    def end(number: int, frame: FrameType | None) -> None:
        _asked_to_end.set()
        # Engines ask the processes of a job twice. What is being cleaned up must not be disturbed.
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    except Exception as error:
        # Who tries whether a module can be imported, as trimesh does, takes the end for a failure.
        if _asked_to_end.is_set():
            raise Terminated from error
        raise
    finally:
        if signal.getsignal(signal.SIGTERM) == end:
            signal.signal(signal.SIGTERM, before)


def fail(message: str, status: int) -> int:
    """Says what is wrong on stderr; returns the status."""
    say(f"pointmorph: {message}", sys.stderr)
    return status


def say(line: str, stream: TextIO | None = None) -> None:
    """Prints a line: on a terminal, broken to its width, further lines under what is last in a
    table, or indented."""
    stream = sys.stdout if stream is None else stream
    if stream is not None and stream.isatty():
        width = max(40, shutil.get_terminal_size().columns)
        indent = len(line) - len(line.lstrip())
        column = line.rfind("  ") + 2
        below = column if indent < column <= width // 2 else indent + 2
        line = textwrap.fill(
            line, width, subsequent_indent=" " * below,
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
    print(line, file=stream)


class _LastingOutput:
    """Standard output that goes on where whoever reads it has stopped, as `head` does."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except BrokenPipeError:
            self._give_up()
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._give_up()

    def _give_up(self) -> None:
        """What is still to be written goes nowhere, also at the end of the process."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def lasting_output() -> Iterator[None]:
    """Meanwhile, a run isn't ended by the end of whoever reads what it prints."""
    before = sys.stdout
    if before is None:
        yield
        return
    lasting: Any = _LastingOutput(before)
    sys.stdout = lasting
    try:
        yield
    finally:
        lasting.flush()
        sys.stdout = before


@contextlib.contextmanager
def bars() -> Iterator[Progress]:
    """A progress function: one bar per stage on a terminal, nothing in a pipe. It raises
    Terminated where an import has taken SIGTERM for its own failure and gone on."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield lambda _stage, _fraction: _go_on()
        return
    from tqdm import tqdm  # whose import takes a tenth of a small morph

    shown: dict[str, Any] = {}

    def progress(stage: str, fraction: float) -> bool:
        _go_on()
        if stage not in shown:
            finish()
            shown[stage] = tqdm(
                total=100,
                desc=f"{stage_label(stage):<24}",
                leave=False,
                bar_format="{desc} {bar:40} {percentage:3.0f}%",
            )
        bar = shown[stage]
        bar.update(max(0.0, round(100 * fraction) - bar.n))
        return True

    def finish() -> None:
        for bar in shown.values():
            bar.close()
        shown.clear()

    try:
        yield progress
    finally:
        finish()


def _go_on() -> bool:
    if _asked_to_end.is_set():
        raise Terminated
    return True
