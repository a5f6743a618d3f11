"""``pointmorph farm openjd``: its templates are run by the reference runner."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from farm_models import FRAMES, TRIES, frames_of, same_frames, write_models
from farm_trials import OpenJD, needs_blender, processes, small_trials, trial_differences
from test_stored_commands import run

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("openjd") is None, reason="openjd-cli isn't installed"
)

OPENJD = [sys.executable, "-m", "openjd"]


def template_of(jobs: Path, *options: object) -> Path:
    path = jobs.parent / "template.json"
    done = run("farm", "openjd", jobs, "--template", path, *options)
    assert done.returncode == 0, done.stderr
    return path


def openjd(*words: object) -> list[str]:
    return [*OPENJD, *map(str, words), "-p", f"Python={sys.executable}"]


def check(template: Path) -> None:
    done = subprocess.run([*OPENJD, "check", str(template)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_template_is_run_as_it_is_after_a_kill_as_well(tmp_path: Path) -> None:
    (tmp_path / "project").mkdir()
    first = write_models(tmp_path / "project")
    template_of(first, "--chunk", FRAMES // 2)
    # Paths in the template are beside it: the folder can lie elsewhere by then.
    shutil.move(tmp_path / "project", tmp_path / "moved")
    template, out = tmp_path / "moved" / "template.json", tmp_path / "moved" / "batch"
    assert str(tmp_path) not in template.read_text()
    check(template)
    steps = [step["name"] for step in json.loads(template.read_text())["steps"]]
    assert steps == ["Maps", "Frames", "Report"]

    maps = subprocess.run(
        openjd("run", template, "--step", "Maps", "-tp", "Pairs=0"), capture_output=True, text=True
    )
    assert maps.returncode != 0  # both pairs are one task, and one can't be morphed
    assert (out / "a_to_b" / "pair.morph").exists()
    words = openjd("run", template, "--step", "Frames", "--tasks",
                   json.dumps([{"Pairs": "0", "Part": str(k)} for k in (0, 1)]))  # fmt: skip
    for _ in range(TRIES):  # one may be over before it can be killed
        shutil.rmtree(out / "a_to_b" / "frames", ignore_errors=True)
        job = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while job.poll() is None and len(frames_of(out)) <= 5:
            time.sleep(0.02)
        for process in processes("--part", "0/2", str(out)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        if job.wait(timeout=100) != 0:
            break
    assert job.returncode != 0
    before = {path: path.stat().st_mtime_ns for path in frames_of(out)[:4]}
    assert len(frames_of(out)) < FRAMES
    again = subprocess.run(words, capture_output=True, text=True)
    assert again.returncode == 0, again.stdout
    assert all(path.stat().st_mtime_ns == at for path, at in before.items())
    report = subprocess.run(
        openjd("run", template, "--step", "Report"), capture_output=True, text=True
    )
    assert report.returncode != 0  # of the pair that wasn't morphed
    assert "a_to_c: the map and the frames to do" in report.stdout
    local = run("batch", tmp_path / "moved" / "jobs.json", "--out", tmp_path / "l", "--range", "0")
    assert local.returncode == 0, local.stderr
    assert same_frames(out, tmp_path / "l")


def test_blender_renders_the_frames_of_a_step(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="Blender as a Python package isn't installed")
    script = Path(__file__).resolve().parents[3] / "docs" / "examples" / "render_frames.py"
    command = ["{python}", str(script), "--", "{frames}", "{out}", "{first}", "{last}"]
    jobs = write_models(tmp_path, render=[*command, "--width", "48", "--samples", "1"], frames=3)
    jobs.write_text(jobs.read_text().replace('"c.obj"', '"b.obj"'))
    template = template_of(jobs, "--chunk", 2)
    check(template)
    done = run("batch", jobs, "--range", "0")
    assert done.returncode == 0, done.stderr
    words = openjd("run", template, "--step", "Renders", "-tp", "Pairs=0", "-tp", "Part=1")
    rendered = subprocess.run(words, capture_output=True, text=True)
    assert rendered.returncode == 0, rendered.stdout
    renders = tmp_path / "batch" / "a_to_b" / "renders"
    assert sorted(path.name for path in renders.iterdir()) == ["0001.png", "0002.png"]
    pillow = pytest.importorskip("PIL.Image")
    picture = pillow.open(renders / "0002.png").convert("L")
    low, high = picture.getextrema()
    assert picture.size == (48, 48)
    assert high - low > 60  # the shape before its background

    def renewed(*options: str) -> list[str]:
        """Which pictures another run of the script makes anew."""
        before = {path: path.stat().st_mtime_ns for path in renders.iterdir()}
        words = [sys.executable, script, "--", frames, renders, "1", "2", "--samples=1", *options]
        subprocess.run(words, check=True, capture_output=True)
        return sorted(path.name for path, at in before.items() if path.stat().st_mtime_ns != at)

    frames = tmp_path / "batch" / "a_to_b" / "frames"
    shutil.copy(frames / "frame_0000.ply", frames / "frame_0002.ply")
    assert renewed("--width=48") == ["0002.png"]
    assert renewed("--width=40") == ["0001.png", "0002.png"]


@needs_blender
def test_pairs_and_renders_are_those_of_a_loop_after_kills(tmp_path: Path) -> None:
    for jobs, kills in small_trials(tmp_path):
        assert trial_differences(OpenJD(), jobs, kills) == []


def test_what_is_wrong_is_said_before_a_template_is_written(tmp_path: Path) -> None:
    for render, name, status, words in (
        (["blender", 3], "t.json", 1, 'a command as "render"'),
        ("blender", "t.json", 1, 'type list as "render"'),
        ([], "t.yaml", 1, "ends in .json"),
    ):
        jobs = write_models(tmp_path, render=render)
        done = run("farm", "openjd", jobs, "--template", tmp_path / name)
        assert done.returncode == status
        assert words in done.stderr
        assert not (tmp_path / name).exists()
    jobs = write_models(tmp_path)
    (tmp_path / "below").mkdir()
    done = run("farm", "openjd", jobs, "--template", tmp_path / "below" / "t.json")
    assert done.returncode == 1
    assert "Put the template in a folder" in done.stderr
    done = run("batch", jobs, "--render", "0/2")
    assert done.returncode == 2
    assert 'a "render" command' in done.stderr
