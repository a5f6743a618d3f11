"""How many pairs of ``pointmorph batch`` run side by side in the memory that is free."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pointmorph.batch import free_memory, runs
from pointmorph.batch.jobs import PairJob
from pointmorph.batch.runs import DONE, FAILED, BatchRun, PairOutcome


class _Process:
    """A program that takes a while and some memory, or fails when it gets too little."""

    def __init__(self, ends_after: int, status: int) -> None:
        self.pid, self.returncode = 0, status
        self._polls = ends_after

    def poll(self) -> int | None:
        self._polls -= 1
        return None if self._polls > 0 else self.returncode


def simulated(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    memory: list[int],
    most: int,
    status: Callable[[str, int], int],
) -> tuple[list[PairOutcome], list[list[str]], list[str]]:
    """Runs pairs that take so much memory where 1000 bytes are free; what runs beside what, and in
    which order they ended."""
    jobs = [
        PairJob(f"pair{k}", tmp_path, tmp_path, tmp_path / f"pair{k}") for k in range(len(memory))
    ]
    beside: list[list[str]] = []
    batch = BatchRun(jobs, most)
    running: dict[str, _Process] = {}

    def start(one: runs._Running) -> _Process:
        for name in [name for name, p in running.items() if p._polls <= 0]:
            del running[name]
        name = one.outcome.job.name
        running[name] = _Process(3 + len(beside) % 4, status(name, len(running)))
        beside.append(list(running))
        return running[name]

    monkeypatch.setattr(PairJob, "identity", lambda job: "")
    monkeypatch.setattr(runs, "steps_to_do", lambda job, with_frames: ["frames"])
    monkeypatch.setattr(runs, "free_memory", lambda: 1000)
    monkeypatch.setattr(runs, "_POLL", 0.0)
    monkeypatch.setattr(batch, "_expected", lambda job: memory[int(job.name.removeprefix("pair"))])
    monkeypatch.setattr(batch, "_process", start)
    told: list[str] = []
    batch.run(lambda outcome: told.append(outcome.job.name))
    assert sorted(told) == sorted(job.name for job in jobs)
    return batch.outcomes, beside, told


def test_no_more_run_side_by_side_than_memory_and_cores_allow(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    random = np.random.default_rng(3)
    memory = [int(m) for m in random.integers(50, 600, 60)]
    memory[20] = 5000  # more than there is: it runs alone
    outcomes, beside, _ = simulated(monkeypatch, tmp_path, memory, 4, lambda *_: 0)
    assert all(outcome.state == DONE for outcome in outcomes)
    for names in beside:
        together = sum(memory[int(name.removeprefix("pair"))] for name in names)
        assert len(names) == 1 or (together <= 900 and len(names) <= 4)
    assert max(map(len, beside)) > 2
    assert ["pair20"] in beside


def test_a_pair_that_runs_out_of_memory_beside_others_is_tried_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def status(name: str, beside: int) -> int:
        if name == "pair4":
            return -9
        return -9 if name == "pair2" and beside > 0 else 0

    outcomes, beside, told = simulated(monkeypatch, tmp_path, [100] * 8, 3, status)
    assert [o.state for o in outcomes] == [FAILED if k == 4 else DONE for k in range(8)]
    assert "signal 9" in outcomes[4].message
    assert {"pair2", "pair4"} == set(told[-2:])
    assert ["pair2"] in beside
    assert ["pair4"] in beside


def group(folder: Path, version: int, limit: str, used: int, of_files: int = 0) -> None:
    """Makes up a control group's files, in MB."""
    folder.mkdir(parents=True, exist_ok=True)
    limits, name, files = free_memory._NAMES["cgroup" if version == 1 else "cgroup2"]
    (folder / limits[0]).write_text(f"{int(limit) << 20}\n" if limit.isdecimal() else f"{limit}\n")
    (folder / name).write_text(f"{used << 20}\n")
    others = f"{'inactive_file' if version == 1 else 'total_inactive_file'} 7\n"
    (folder / "memory.stat").write_text(f"anon 5\n{others}{files} {of_files << 20}\n")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has control groups")
@pytest.mark.parametrize(
    ("version", "root", "own", "groups", "free"),
    [
        (2, "/", "/", {"": ("10", 3, 1)}, 8),
        (2, "/", "/", {"": ("max", 3, 1)}, None),
        (2, "/", "/", {"": ("5", 8, 1)}, 0),
        # As systemd makes them: the root has no limit, and the least of what is left counts.
        (2, "/", "/a.slice/b.scope", {"a.slice/b.scope": ("9", 2)}, 7),
        (2, "/", "/a.slice/b.scope", {"a.slice": ("9", 2), "a.slice/b.scope": ("max", 1)}, 7),
        (2, "/", "/a.slice/b.scope", {"a.slice": ("9", 6, 1), "a.slice/b.scope": ("7", 1)}, 4),
        (2, "/", "/a.slice/b.scope", {"c.slice": ("1", 0)}, None),
        (1, "/", "/", {"": ("10", 3, 1)}, 8),
        (1, "/", "/", {"": (str((1 << 43) - 1), 3)}, (1 << 43) - 4),  # without a limit
        (1, "/", "/a/b", {"a": ("9", 2), "a/b": ("6", 1)}, 5),
        # In a container that sees its own group at the mount.
        (1, "/docker/1", "/docker/1", {"": ("9", 2)}, 7),
        (1, "/docker/1", "/docker/1/a", {"": ("9", 2), "a": ("3", 1)}, 2),
        (1, "/docker/1", "/", {"": ("9", 2)}, 7),
    ],
)
def test_the_least_of_the_limits_of_control_groups_counts(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    version: int,
    root: str,
    own: str,
    groups: dict[str, tuple[str, int]],
    free: int | None,
) -> None:
    mounts = {"cpu": "cgroup", "nsdelegate": "cgroup2"}
    lines = ["1:name=systemd:/else:where", f"3:cpu,cpuacct:{own}", f"0::{own}"]
    if version == 1:
        mounts["memory"] = "cgroup"
        lines.append(f"4:memory:{own}")
    monkeypatch.setattr(free_memory, "_PROCESS", tmp_path)
    assert free_memory._free_in_groups() is None
    (tmp_path / "cgroup").write_text("\n".join(lines))
    lines = ["21 1 8:1 / / rw,relatime - ext4 /dev/sda1 rw"]
    for number, (option, kind) in enumerate(mounts.items(), 31):
        place = f"{number} 21 0:{number} {root} {tmp_path / option} rw,nosuid shared:7"
        lines.append(f"{place} - {kind} {kind} rw,{option}")
    (tmp_path / "mountinfo").write_text("\n".join(lines))
    (tmp_path / "nsdelegate").mkdir()
    for name, content in groups.items():
        group(tmp_path / ("memory" if version == 1 else "nsdelegate") / name, version, *content)
    assert free_memory._free_in_groups() == (None if free is None else free << 20)


def test_free_memory_is_no_more_than_a_container_may_take(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = free_memory.free_memory()
    if sys.platform == "linux":
        assert whole is not None
        assert whole > 1 << 20
        for left, free in ((5, 5), (0, 0), (1 << 60, None)):
            monkeypatch.setattr(free_memory, "_free_in_groups", lambda left=left: left)
            found = free_memory.free_memory()
            assert found is not None
            assert found == free if free is not None else 1 << 20 < found < left
    assert free_memory.taken_by(1 << 30) == 0


def test_a_soft_limit_of_a_control_group_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    group(tmp_path, 2, "9", 2)
    monkeypatch.setattr(free_memory, "_groups", lambda: iter([("cgroup2", tmp_path)]))
    for high, free in (("max", 7 << 20), ("20000000", 7 << 20), ("3000000", 3000000 - (2 << 20))):
        (tmp_path / "memory.high").write_text(f"{high}\n")
        assert free_memory._free_in_groups() == free
