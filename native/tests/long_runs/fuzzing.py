"""Any bytes as questions to the library, chosen by libFuzzer, for as long as it is told to.

python native/tests/long_runs/fuzzing.py --seconds 600 --dear-seconds 1800 --report FILE.json

Needs Debian's clang-16 and libclang-rt-16-dev, and gets them where it may. `native/tests/fuzzing`
says what is asked and what must hold. Inputs that take new ways are kept in `--corpus`; from there,
a few are copied into `corpus.hpp`, and every find. With `--questions`, only these are tried, and
take the place of their rows in the report that is there at the end: several runs side by side, each
of some questions, make one. With `--more`, what they have tried is added to those rows instead.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(ROOT / "native")]

from build_tools.system import set_up_system  # noqa: E402
from reporting import Report  # noqa: E402

QUESTIONS = ("options", "shapes", "saved morphs", "transforms", "morphs", "previews")
"""In the order of `Question` in any_input.hpp."""
DEAR = ("morphs", "previews")
"""Those that compute whole maps, each of which takes up to seconds."""
PATIENCE = 3600
"""Seconds after which an input hangs: where the machine is busy, one of seconds takes minutes."""


def built(folder: Path) -> Path:
    """The program that libFuzzer runs."""
    set_up_system(["build", "fuzz"])
    settings = ["-DCMAKE_CXX_COMPILER=clang++-16", "-DPOINTMORPH_FUZZ=ON"]
    settings += ["-DPOINTMORPH_THREADS=pool"]
    subprocess.run(["cmake", "-S", ROOT, "-B", folder, "-G", "Ninja", *settings], check=True)
    subprocess.run(["ninja", "-C", folder, "pointmorph_fuzz"], check=True)
    return folder / "pointmorph_fuzz"


def kept_inputs() -> list[bytes]:
    text = (ROOT / "native" / "tests" / "fuzzing" / "corpus.hpp").read_text()
    return [bytes.fromhex(line) for line in re.findall(r'^ +"([0-9a-f]+)",$', text, re.MULTILINE)]


def run(program: Path, folder: Path, seconds: int) -> tuple[int, str]:
    """Tries for so long, in processor time, or until the first find: how many inputs, and what was
    found."""
    options = ["-max_len=300", f"-timeout={PATIENCE}", "-rss_limit_mb=3000"]
    options += ["-print_final_stats=1", f"-artifact_prefix={folder}-find-"]
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0:handle_abort=2"}
    with tempfile.TemporaryFile("w+") as said:
        fuzzer = subprocess.Popen([program, folder, *options], stderr=said, env=environment)
        while fuzzer.poll() is None:
            if processor_seconds(fuzzer.pid) > seconds:
                fuzzer.send_signal(signal.SIGUSR1)  # it ends after the input that it is at
            time.sleep(1)
        said.seek(0)
        words = said.read()
    tried = re.findall(r"number_of_executed_units: (\d+)", words)
    return int(tried[-1]) if tried else 0, words[-1500:] if fuzzer.returncode else ""


def processor_seconds(process: int) -> float:
    """Of one that runs or was not waited for."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def try_question(program: Path, corpus: Path, question: str, seconds: int) -> tuple[int, str]:
    """The same, beginning with the inputs that are kept."""
    folder = corpus / question.replace(" ", "_")
    folder.mkdir(parents=True, exist_ok=True)
    for place, content in enumerate(kept_inputs()):
        if content[0] % len(QUESTIONS) == QUESTIONS.index(question):
            (folder / f"kept{place}").write_bytes(content)
    return run(program, folder, seconds)


def take_over(report: Report, path: Path, questions: Sequence[str]) -> None:
    """Adds what another report says of some questions."""
    earlier = json.loads(path.read_text())
    for question in questions:
        if question in earlier["tried"]:
            tried = int(report.tried.get(question, 0)) + earlier["tried"][question]
            report.tried[question] = tried
        report.finds += [find for find in earlier["finds"] if find.startswith(question)]
    report.began -= earlier["processor_seconds"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=600, help="processor time for each question")
    parser.add_argument("--dear-seconds", type=int, default=1800, help="for each that is dear")
    parser.add_argument("--questions", nargs="+", choices=QUESTIONS, default=QUESTIONS)
    parser.add_argument("--more", action="store_true", help="add to what the report says of them")
    parser.add_argument("--corpus", type=Path, default=ROOT / "build" / "corpus")
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    program = built(ROOT / "build" / "fuzz")
    report = Report("Any bytes as input of the library")
    for question in chosen.questions:
        seconds = chosen.dear_seconds if question in DEAR else chosen.seconds
        report.tried[question], find = try_question(program, chosen.corpus, question, seconds)
        report.finds += [f"{question}: {find}"] if find else []
    if chosen.questions is not QUESTIONS and chosen.report and chosen.report.exists():
        others = [question for question in QUESTIONS if question not in chosen.questions]
        take_over(report, chosen.report, QUESTIONS if chosen.more else others)
    report.tried = {what: report.tried[what] for what in QUESTIONS if what in report.tried}
    report.tried["inputs"] = sum(int(count) for count in report.tried.values())
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
