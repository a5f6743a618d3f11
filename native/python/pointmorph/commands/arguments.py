"""How commands read their arguments; a wrong one is told with what was expected."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from pointmorph.commands import terminal


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and what was perhaps meant, without a list of all options."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"formatter_class": _Help, "allow_abbrev": False, **settings})

    def error(self, message: str) -> NoReturn:
        text = message.removeprefix("argument ")
        end = "" if text.endswith("?") else "."
        self.exit(terminal.WRONG_CALL, f"pointmorph: {text}{end} See {self.prog} --help.\n")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Refuses what is left over right here, where the options that there are, are known."""
        chosen, left = super().parse_known_args(args, namespace)
        if left:
            first = left[0].partition("=")[0]
            if not first.startswith("-"):
                self.error(f"too many arguments: {' '.join(left)}")
            self.error(f"unknown option {first}{self._meant(first, self._option_string_actions)}")
        return chosen, left

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        words = [str(choice) for choice in action.choices]
        text = f"expected one of {', '.join(words)}, found {value!r}"
        raise argparse.ArgumentError(action, f"{text}{self._meant(str(value), words)}")

    @staticmethod
    def _meant(word: str, there: Any) -> str:
        close = difflib.get_close_matches(word.replace("_", "-"), list(there), 1, 0.7)
        return f". Did you mean {close[0]}?" if close else ""


class _Help(argparse.HelpFormatter):
    """Lists an option by one name, though it may be written with underscores as well."""

    def _format_action_invocation(self, action: argparse.Action) -> str:
        names = action.option_strings
        action.option_strings = [name for name in names if "_" not in name] or names
        try:
            return super()._format_action_invocation(action)
        finally:
            action.option_strings = names


def whole_number(text: str) -> int:
    if not re.fullmatch(r"\s*[+-]?\d+\s*", text):
        raise argparse.ArgumentTypeError(f"expected a whole number, found {text!r}")
    return int(text)


def number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number, found {text!r}") from None


def frame_count(text: str) -> int:
    count = whole_number(text)
    if count < 0 or count == 1:
        raise argparse.ArgumentTypeError(f"expected 0 or at least 2, found {text}")
    return count


def some_frames(text: str) -> int:
    count = whole_number(text)
    if count < 2:
        raise argparse.ArgumentTypeError(f"expected at least 2, found {text}")
    return count


def distance(text: str) -> float:
    length = number(text)
    if not 1e-4 <= length <= 1:
        raise argparse.ArgumentTypeError(f"expected a number from 0.0001 to 1, found {text}")
    return length


def positive(text: str) -> int:
    count = whole_number(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, found {text}")
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
