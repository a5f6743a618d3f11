"""``pointmorph batch``: many pairs by one file of jobs."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from command_runs import COMMAND
from pointmorph import formats
from pointmorph.batch import jobs, reports
from pointmorph.batch.jobs import read_batch
from pointmorph.batch.runs import DONE, FAILED, KEPT, PairOutcome
from pointmorph.batch.tasks import FarmStep, Part, farm_steps, frames_in_task, has_renders, render
from test_stored_commands import run, write_obj

QUICK = {"method": "paper"}


def write_jobs(into: Path, **content: object) -> Path:
    path = into / "jobs.json"
    path.write_text(json.dumps(content))
    return path


def models(folder: Path, *names: str) -> None:
    """Small models, each with another number of vertices."""
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        write_obj(folder / f"{name}.obj", 7 + 2 * number, 0.3 * number)


def times_of(folder: Path) -> dict[Path, int]:
    """When all that a run has made of pairs was written, but for what a program said."""
    paths = [*folder.rglob("*.ply"), *folder.rglob("*.morph"), *folder.rglob("*.png")]
    return {path: path.stat().st_mtime_ns for path in paths}


def states(out: Path) -> dict[str, str]:
    rows = json.loads((out / "batch.json").read_text())["pairs"]
    return {row["pair"]: row["state"] for row in rows}


def arrays_of(path: Path) -> object:
    """Checksums of all arrays; what a file says about itself has times in it."""
    return pointmorph.open_morph(path).header["arrays"]


# --- The file of jobs -----------------------------------------------------------------------------


def test_pairs_a_template_and_a_folder_in_one_file(tmp_path: Path) -> None:
    models(tmp_path / "heads", "a", "b", "c")
    models(tmp_path, "base")
    (tmp_path / "heads" / "notes.md").write_text("no model")
    path = write_jobs(
        tmp_path, frames=4, settings={"method": "paper"}, out="made",
        pairs=[{"source": "base.obj", "target": "heads/a.obj", "name": "../a b", "frames": 0},
               {"source": "base.obj", "target": "heads/a.obj"}],
        template={"source": "base.obj", "targets": "heads/*", "features": "{source}-{target}.json"},
        folder={"path": "heads", "both_ways": True, "settings": {"wrap-conform": 0.5}},
    )  # fmt: skip
    batch = read_batch(path)
    names = [job.name for job in batch.jobs]
    # A name can't lead out of the folder, and none is taken twice.
    assert names[:3] == ["_a_b", "base_to_a", "base_to_a_2"]
    assert names[3:5] == ["base_to_b", "base_to_c"]
    assert sorted(names[5:]) == [f"{x}_to_{y}" for x in "abc" for y in "abc" if x != y]
    assert all(job.folder == tmp_path / "made" / job.name for job in batch.jobs)
    assert [job.frames for job in batch.jobs] == [0, *[4] * 10]
    assert batch.jobs[3].features == tmp_path / "base-b.json"
    # What an entry says goes before what the file says.
    assert batch.jobs[0].settings == {"method": "paper"}
    assert batch.jobs[5].settings == {"wrap_conform": 0.5}
    words = batch.jobs[5].morph_words()
    assert words[words.index("--wrap-conform") + 1] == "0.5"
    # Without both ways, each pair once.
    path = write_jobs(tmp_path, folder="heads")
    assert [j.name for j in read_batch(path).jobs] == ["a_to_b", "a_to_c", "b_to_c"]


def test_what_is_up_is_said_once_for_pictures_and_maps(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    own = {"source": "b.obj", "target": "a.obj", "settings": {"up": "none"}}
    pairs = [{"source": "a.obj", "target": "b.obj"}, own]
    batch = read_batch(write_jobs(tmp_path, pairs=pairs, up="y", settings={"path": "linear"}))
    assert batch.up == "y"
    assert [job.settings for job in batch.jobs] == [{"up": "y", "path": "linear"}, {"up": "none"}]
    silent = read_batch(write_jobs(tmp_path, pairs=pairs[:1]))
    assert silent.up == "z"
    assert silent.jobs[0].settings == {}


def test_the_page_has_every_key_and_its_example_is_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "docs" / "batch.md").read_text(encoding="utf-8")
    for key in (*jobs._COMMON, *jobs._GROUPS, "out", "up", "render", "render_every"):
        assert f"| `{key}` |" in text
    models(tmp_path / "heads", "a", "b")
    example = text.partition("```json\n")[2].partition("```")[0]
    batch = read_batch(write_jobs(tmp_path, **json.loads(example)))
    assert [job.target.name for job in batch.jobs] == ["a.obj", "b.obj", "lion.ply"]
    assert batch.out == tmp_path / "morphed"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "expected JSON"),
        ('{"pairs": [', "expected JSON"),
        ("[" * 100_000, "too deep"),
        ("[]", "expected an object"),
        ("{}", "at least one pair"),
        ('{"pairs": {}}', 'type list as "pairs"'),
        ('{"pairs": [3]}', "an object with"),
        ('{"pairs": [{"source": "a.obj"}]}', "a source and a target"),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj", "weight": 1}]}', "an object with"),
        ('{"template": {"source": "a.obj"}}', "a source and targets"),
        ('{"template": {"source": "a.obj", "targets": "*.stl"}}', "models that match *.stl"),
        ('{"folder": "."}', "at least two models"),
        ('{"folder": "nowhere"}', "at least two models"),
        ('{"pair": []}', 'found "pair"'),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj"}], "up": "x"}', "y or z"),
        (
            '{"pairs": [{"source": "a.obj", "target": "b.obj"}], "render_every": 0}',
            'a number from 1 as "render_every"',
        ),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj", "frames": 1}]}', "at least 2 frames"),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj", "frames": true}]}', "type int"),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj", "samples": 0}]}', "at least 1"),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj", "mesh": "dwg"}]}', 'as "mesh"'),
        ('{"pairs": [{"source": "a.obj", "target": "b.obj"}], "settings": {"x": 1}}', "options.md"),
        (
            '{"pairs": [{"source": "a.obj", "target": "b.obj", "settings": {"method": []}}]}',
            "a number or a word",
        ),
    ],
)
def test_a_damaged_file_of_jobs_is_refused_in_words(tmp_path: Path, text: str, found: str) -> None:
    models(tmp_path, "a")
    path = tmp_path / "jobs.json"
    path.write_text(text)
    done = run("batch", path)
    assert done.returncode == 1
    assert str(path) in done.stderr
    assert found in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "batch").exists()


def test_wrong_calls(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    path = write_jobs(tmp_path, folder=".")
    for options, words in (
        (["--range", "1:"], "some of the pairs 0 to 0"),
        (["--part", "2/2"], "expected K/N"),
        (["--range", "3/2"], "expected K/N"),
        (["--jobs", "0"], "at least 1"),
        (["--maps", "--report"], "not allowed with"),
    ):
        done = run("batch", path, *options)
        assert done.returncode == 2
        assert words in done.stderr
    missing = run("batch", tmp_path / "none.json")
    assert missing.returncode == 1
    assert "none.json: expected a readable file" in missing.stderr


# --- Runs -----------------------------------------------------------------------------------------


class _Page(HTMLParser):
    """Words and pictures of a page; every element has to be closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.pictures, self._open = "", [], []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag == "img":
            self.pictures.append(dict(attributes)["src"])
        elif tag not in ("meta", "br"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def test_a_batch_with_a_pair_that_fails_is_completed_later(tmp_path: Path) -> None:
    models(tmp_path / "models", "a", "b")
    (tmp_path / "models" / "c&amp;.obj").write_text("v 0 0\n")
    path = write_jobs(
        tmp_path, frames=3, settings=QUICK,
        template={"source": "models/a.obj", "targets": ["models/c*.obj", "models/b.obj"]},
    )  # fmt: skip
    out = tmp_path / "batch"
    first = run("batch", path, "--jobs", 2)
    assert first.returncode == 3, first.stderr
    assert states(out) == {"a_to_c_amp_": FAILED, "a_to_b": DONE}
    assert "1 morphed, 0 already done, 1 failed" in first.stdout
    page = _Page((out / "index.html").read_text(encoding="utf-8"))
    assert page.pictures == ["pictures/a_to_b.png"]
    failure = json.loads((out / "batch.json").read_text())["pairs"][0]
    for text in (page.words, first.stdout):
        assert failure["message"] in text
    assert "c&amp;.obj" in failure["message"]
    # The same bits as by the command for one pair.
    single = run("morph", tmp_path / "models" / "a.obj", tmp_path / "models" / "b.obj", "--out",
                 tmp_path / "one", "--frames", 3, "--method", "paper")  # fmt: skip
    assert single.returncode == 0, single.stderr
    for k in range(3):
        made = (out / "a_to_b" / "frames" / f"frame_000{k}.ply").read_bytes()
        assert made == (tmp_path / "one" / f"frame_000{k}.ply").read_bytes()

    # Mended, the pair that failed is morphed; the other isn't touched.
    before = times_of(out)
    write_obj(tmp_path / "models" / "c&amp;.obj", 9, 0.6)
    second = run("batch", path)
    assert second.returncode == 0, second.stderr
    assert states(out) == {"a_to_c_amp_": DONE, "a_to_b": KEPT}
    assert before.items() <= times_of(out).items()
    # A damaged frame and a damaged map are noticed, and made anew as they were.
    frame, map_ = out / "a_to_b" / "frames" / "frame_0001.ply", out / "a_to_c_amp_" / "pair.morph"
    contents = frame.read_bytes(), arrays_of(map_)
    for file in (frame, map_):
        changed = bytearray(file.read_bytes())
        changed[-7] ^= 1
        file.write_bytes(changed)
    report = run("batch", path, "--report")
    assert report.returncode == 1
    assert "a_to_b: the frames to do" in report.stdout
    assert "a_to_c_amp_: the map and the frames to do" in report.stdout
    kept = times_of(out / "a_to_b")
    third = run("batch", path)
    assert third.returncode == 0, third.stderr
    assert (frame.read_bytes(), arrays_of(map_)) == contents
    assert {p for p, at in times_of(out / "a_to_b").items() if kept[p] != at} == {frame}
    assert run("batch", path, "--report").returncode == 0


def test_figures_of_other_versions_reports_are_kept(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    pairs = [{"source": "a.obj", "target": "b.obj"}]
    (job,) = read_batch(write_jobs(tmp_path, pairs=pairs)).jobs
    job.folder.mkdir(parents=True)
    way = {"coverage": 0.996, "flipped": 0.0}
    known = {"seconds": 1.0, "pairs": 9, "peak_memory_bytes": 1, "warnings": []}
    place = {"source": 0, "target": 0, "flaw": "lost", "advice": "Mark it."}
    torn = {**place, "flaw": "torn", "advice": "It is torn.", "where": "toward +X of a"}
    for worst, advice in (([place, torn], ["Mark it", "It is torn"]), ([{}], []), ([3], [])):
        report = {**known, "quality": {"there": way}, "worst": worst}
        (job.folder / jobs.REPORT).write_text(json.dumps(report))
        (row,) = reports.rows([PairOutcome(job, DONE)])
        assert (row["covered"], row["advice"]) == (0.996, advice)
        assert "99.6 %" in reports.table([row])[1]


def test_a_template_with_faces_goes_onto_each_of_its_targets(tmp_path: Path) -> None:
    heights = {"a": 0.1, "b": 0.25, "c": 0.4}
    (tmp_path / "targets").mkdir()
    for number, (name, height) in enumerate(heights.items()):
        write_obj(tmp_path / "targets" / f"{name}.obj", 15 + 2 * number, height)
    write_obj(tmp_path / "base.obj", 14, 0.0)
    template = {"source": "base.obj", "targets": "targets/*.obj"}
    path = write_jobs(tmp_path, template=template, frames=2, mesh="source")
    done = run("batch", path)
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "batch" / "batch.json").read_text())["pairs"]
    assert {row["mesh"] for row in rows} <= {"good", "fair"}
    base = formats.read(tmp_path / "base.obj")
    for row, height in zip(rows, heights.values(), strict=True):
        wrapped = formats.read(Path(row["folder"]) / "frames" / "mesh_0001.obj")
        assert np.array_equal(wrapped.faces, base.faces)
        x, y, z = wrapped.positions.T
        # The target's faces lie below its bump by a share of their size.
        assert np.abs(z - height * np.exp(-3 * (x**2 + y**2))).max() < 0.03 * height
        assert np.ptp(x) > 1.95
        assert np.ptp(y) > 1.95


def test_tasks_of_an_engine_make_what_a_run_makes(tmp_path: Path) -> None:
    models(tmp_path, "a", "b", "c")
    path = write_jobs(tmp_path, folder=".", frames=5, resample=True, settings=QUICK)
    early = run("batch", path, "--out", tmp_path / "tasks", "--range", "1", "--part", "0/2")
    assert early.returncode == 1
    assert "batch --maps" in early.stderr
    for options in (["--maps"], ["--maps"], ["--part", "1/2"], ["--part", "0/2"]):
        done = run("batch", path, "--out", tmp_path / "tasks", "--range", "1", *options)
        assert done.returncode == 0, done.stderr
    report = run("batch", path, "--out", tmp_path / "tasks", "--report")
    assert report.returncode == 3
    assert states(tmp_path / "tasks") == {"a_to_b": "pending", "a_to_c": KEPT, "b_to_c": "pending"}
    whole = run("batch", path, "--out", tmp_path / "run", "--range", "1:2")
    assert whole.returncode == 0, whole.stderr
    assert not (tmp_path / "run" / "batch.json").exists()
    made = sorted((tmp_path / "run" / "a_to_c").rglob("*.ply"))
    assert len(made) == 5 + 2
    for file in made:
        assert file.read_bytes() == (tmp_path / "tasks" / file.relative_to(tmp_path / "run")
                                     ).read_bytes()  # fmt: skip


def test_a_task_of_several_pairs_does_what_can_be_done(tmp_path: Path) -> None:
    models(tmp_path, "a", "b", "d")
    (tmp_path / "c.obj").write_text("v 0 0\n")
    path = write_jobs(
        tmp_path, template={"source": "a.obj", "targets": "*.obj"}, frames=3, settings=QUICK,
        render=[sys.executable, "-c", "pass"],
    )  # fmt: skip
    out, word = tmp_path / "batch", "c.obj: expected"
    for option, words in (
        (["--maps"], word), (["--maps"], word), (["--part", "0/1"], "batch --maps"),
        (["--render", "0/1"], "batch --maps"),
    ):  # fmt: skip
        done = run("batch", path, "--range", "0/1", *option)
        assert done.returncode == 1
        assert words in done.stderr
        assert done.stdout.count("the map is already there") in (0, 2)
    run("batch", path, "--report", "--renders")
    assert states(out) == {"a_to_b": KEPT, "a_to_c": "pending", "a_to_d": KEPT}
    # What has become of frames since is noticed before they are rendered.
    (out / "a_to_d" / "frames" / "frame_0001.ply").write_text("no frame")
    again = run("batch", path, "--range", "1/2", "--render", "0/1")
    assert again.returncode == 1
    assert "a_to_d: " in again.stderr
    assert "batch --part" in again.stderr
    assert run("batch", path, "--range", "0/2", "--render", "0/1").returncode == 0
    for option in ([], ["--maps"], ["--part", "0/1"]):  # of so many tasks some have no pair
        assert run("batch", path, "--range", "0/9", *option).returncode == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes in another way")
def test_a_killed_task_of_several_pairs_loses_only_the_one_in_hand(tmp_path: Path) -> None:
    names = [f"m{k}" for k in range(12)]
    models(tmp_path, *names)
    path = write_jobs(
        tmp_path, template={"source": "m0.obj", "targets": "*.obj"}, settings=QUICK
    )  # fmt: skip
    out, words = tmp_path / "batch", ["batch", str(path), "--range", "0/1", "--maps"]
    task = subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL)
    while task.poll() is None and len(list(out.glob("*/job.json"))) < 2:
        time.sleep(0.01)
    task.kill()
    task.wait()
    kept = times_of(out)
    found = len(list(out.glob("*/job.json")))
    assert found >= 2
    again = run(*words)
    assert again.returncode == 0, again.stderr
    assert again.stdout.count("the map is already there") == found
    done = {path.parent for path in out.glob("*/job.json")}
    assert len(done) == len(names) - 1
    whole = [path for path, at in kept.items() if path.stat().st_mtime_ns == at]
    assert len([path for path in whole if path.suffix == ".morph"]) >= found


def test_what_is_not_rendered_is_not_done(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    fails = tmp_path / "fails"
    command = [sys.executable, "-c", "import os, sys; sys.exit(os.path.exists(sys.argv[1]))"]
    pairs = [{"source": "a.obj", "target": "b.obj"}]
    path = write_jobs(
        tmp_path, pairs=pairs, frames=4, settings=QUICK, render=[*command, str(fails)]
    )
    batch = read_batch(path, tmp_path / "out")
    [job] = batch.jobs
    assert run("batch", path, "--out", batch.out).returncode == 0  # it renders nothing itself
    assert render(batch, job, Part(0, 2)) == 0
    fails.touch()
    assert render(batch, job, Part(1, 2)) == 1
    report = run("batch", path, "--out", batch.out, "--report", "--renders")
    assert report.returncode == 1
    assert "a_to_b: the renders to do" in report.stdout
    fails.unlink()
    assert render(batch, job, Part(1, 2)) == 0
    assert has_renders(job)
    # Those of another map are of no use.
    job.morph_file.write_bytes(job.morph_file.read_bytes() + b" ")
    assert not has_renders(job)
    wrong = run("batch", path, "--out", batch.out, "--renders")
    assert wrong.returncode == 2
    assert "--report" in wrong.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("ends", "status", "words"),
    [("sys.exit(2)", 1, "status 2"), ("os.kill(os.getpid(), 9)", 128 + 9, "signal 9")],
)
def test_how_a_command_that_renders_has_failed(
    tmp_path: Path, ends: str, status: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    models(tmp_path, "a", "b")
    path = write_jobs(
        tmp_path, folder=".", frames=4, settings=QUICK,
        render=[sys.executable, "-c", f"import os, sys; {ends}"],
    )  # fmt: skip
    batch = read_batch(path)
    [job] = batch.jobs
    for option in (["--maps"], ["--part", "0/1"]):
        assert run("batch", path, "--range", "0/1", *option).returncode == 0
    assert render(batch, job, Part(0, 1)) == status
    assert f"a_to_b: the render command ended with {words}" in capsys.readouterr().err


def test_a_part_without_a_picture_needs_no_command(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    notes = tmp_path / "notes"
    command = [sys.executable, "-c", "import sys; open(sys.argv[1], 'a').write(sys.argv[2])"]
    path = write_jobs(
        tmp_path, folder=".", frames=6, settings=QUICK, render_every=4,
        render=[*command, str(notes), "{first} to {last} by {every}, "],
    )  # fmt: skip
    batch = read_batch(path)
    [job] = batch.jobs
    for option in (["--maps"], ["--part", "0/1"]):
        assert run("batch", path, "--range", "0/1", *option).returncode == 0
    assert [render(batch, job, Part(k, 3)) for k in range(3)] == [0, 0, 0]
    assert notes.read_text() == "0 to 1 by 4, 4 to 5 by 4, "
    assert has_renders(job)


def test_parts_share_out_all_frames() -> None:
    for total in range(20):
        for count in range(1, 9):
            parts = [range(total)[Part(k, count).of(total)] for k in range(count)]
            assert [k for part in parts for k in part] == list(range(total))
            assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_a_task_has_the_more_frames_the_sooner_one_is_made(tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", 9, 0.0)
    write_obj(tmp_path / "b.obj", 9, 0.5)
    found = []
    for more in ({}, {"samples": 100_000}, {"samples": 100_000, "resample": True}):
        pairs = [{"source": "a.obj", "target": "b.obj"}]
        path = tmp_path / "jobs.json"
        path.write_text(json.dumps({"pairs": pairs, "frames": 240, **more}))
        found.append(frames_in_task(read_batch(path, None)))
    assert found[0] > 240  # the frames of small models are one task
    assert found[0] > found[1] > found[2] > 100


@pytest.mark.parametrize(
    ("content", "chunk", "tasks"),
    [
        ({"frames": 4}, None, [("Maps", 2, None), ("Frames", 1, 1), ("Renders", 7, 1)]),
        ({"frames": 4}, 9, [("Maps", 2, None), ("Frames", 20, 1), ("Renders", 20, 1)]),
        ({"frames": 240}, 100, [("Maps", 2, None), ("Frames", 40, 3), ("Renders", 40, 3)]),
        ({"frames": 4, "samples": 200_000}, 2,
         [("Maps", 40, None), ("Frames", 40, 2), ("Renders", 40, 2)]),
        ({"frames": 240, "render_every": 5}, None,
         [("Maps", 2, None), ("Frames", 1, 1), ("Renders", 40, 2)]),
        ({}, None, [("Maps", 2, None)]),
    ],
)  # fmt: skip
def test_tasks_have_several_pairs_where_these_take_little(
    tmp_path: Path, content: dict[str, object], chunk: int | None, tasks: list[object]
) -> None:
    write_obj(tmp_path / "a.obj", 9, 0.0)
    pairs = [{"source": "a.obj", "target": "a.obj"}] * 40
    path = write_jobs(tmp_path, pairs=pairs, render=["true"], **content)
    steps = farm_steps(read_batch(path), chunk)
    assert [(step.name, step.groups, step.parts) for step in steps] == tasks
    assert FarmStep("Frames", "--part", 7, 3).words(2, 1) == ["--range", "2/7", "--part", "1/3"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without asking them")
def test_a_batch_that_is_ended_leaves_nothing_half_written(tmp_path: Path) -> None:
    models(tmp_path, "a", "b")
    path = write_jobs(tmp_path, folder=".", frames=2000, settings=QUICK)
    job = subprocess.Popen(
        [*COMMAND, "batch", str(path)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    frames = tmp_path / "batch" / "a_to_b" / "frames"
    while job.poll() is None and not list(frames.glob("frame_00*.ply")):
        time.sleep(0.01)
    job.send_signal(signal.SIGTERM)
    _, errors = job.communicate(timeout=60)
    assert job.returncode == 143
    assert "Traceback" not in errors
    left = [path for path in tmp_path.rglob("*") if path.name.endswith("-part")]
    assert not left
    count = len(list(frames.glob("frame_*.ply")))
    assert 0 < count < 2000
    # The map is kept.
    path = write_jobs(tmp_path, folder=".", frames=0, settings=QUICK)
    assert run("batch", path).returncode == 0
    assert states(tmp_path / "batch") == {"a_to_b": KEPT}
