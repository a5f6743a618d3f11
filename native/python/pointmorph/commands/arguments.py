"""How commands read their arguments; a wrong one is told with what was expected."""

from __future__ import annotations

import argparse


def frame_count(text: str) -> int:
    count = int(text)
    if count < 0 or count == 1:
        raise argparse.ArgumentTypeError("expected 0 or at least 2")
    return count


def some_frames(text: str) -> int:
    count = int(text)
    if count < 2:
        raise argparse.ArgumentTypeError("expected at least 2")
    return count


def distance(text: str) -> float:
    length = float(text)
    if not 1e-4 <= length <= 1:
        raise argparse.ArgumentTypeError("expected a number from 0.0001 to 1")
    return length


def positive(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError("expected at least 1")
    return count


def part_of(text: str) -> slice:
    """A part of what is counted from 0, as Python slices it; or a single one."""
    first, colon, last = text.partition(":")
    numbers = [part == "" or part.isdecimal() for part in (first, last)]
    if not all(numbers) or not (colon or first):
        raise argparse.ArgumentTypeError("expected A:B, such as 0:24, 24: or :24, or A alone")
    if not colon:
        return slice(int(first), int(first) + 1)
    return slice(int(first) if first else None, int(last) if last else None)
