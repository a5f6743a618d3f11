"""Morphs as files: the same bits, opened in no time, and refused where they aren't whole."""

from __future__ import annotations

import json
import time
import zipfile
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from pointmorph import sequences
from pointmorph.sequences import Chain
from pointmorph.storage import array_files
from shapes import grid, grid_faces

SIDE = 19
TURN = np.array([[1.0, 0, 0], [0, np.cos(1), np.sin(1)], [0, -np.sin(1), np.cos(1)]])
TIMES = (0.0, 0.13, 0.5, 0.77, 1.0)


def sheets(dtype: type = np.float64, *, faces: bool = False, **more: object) -> list:
    """A flat sheet, and one of other points with a bump that is turned."""
    flat, bump = grid(SIDE).astype(dtype), (grid(SIDE + 4, 0.8) @ TURN).astype(dtype)
    colors = np.random.default_rng(3).random((len(flat), 4)).astype(np.float32)
    cells = (grid_faces(SIDE), grid_faces(SIDE + 4)) if faces else (None, None)
    return [
        pointmorph.Cloud(flat, colors=colors, faces=cells[0], **more),
        pointmorph.Cloud(bump, faces=cells[1]),
    ]


def same(one: object, other: object) -> None:
    for name, values in vars(one).items():
        theirs = getattr(other, name)
        assert values.dtype == theirs.dtype, name
        np.testing.assert_array_equal(values, theirs, err_msg=name)


def marks() -> dict[str, tuple[int, int]]:
    return {"corner": (0, 0), "other": (SIDE * SIDE - 1, (SIDE + 4) ** 2 - 1)}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[pointmorph.Morph, Path]:
    result = pointmorph.morph(*sheets(np.float32, faces=True), marks())
    path = tmp_path_factory.mktemp("stored") / "sheets.morph"
    result.save(path, resample=True, origin={"command": ["morph"]})
    return result, path


WAYS = {
    "straight": {"path": "linear"},
    "turning": {"path": "similarity"},
    "bending and hiding": {"path": "rigid", "crowding": 2.0},
    "straight, one after the other": {"path": "linear", "stagger": "x"},
    "paper": {"method": "paper"},
}


@pytest.mark.parametrize("way", WAYS)
def test_every_frame_has_the_same_bits(way: str, tmp_path: Path) -> None:
    dtype = np.float32 if way == "turning" else np.float64
    result = pointmorph.morph(*sheets(dtype), marks(), **WAYS[way])
    # With the plan of new points and without: whoever opens it then finds the same one.
    for name, resample in (("with", True), ("without", False)):
        result.save(tmp_path / f"{name}.morph", resample=resample)
        again = pointmorph.open_morph(tmp_path / f"{name}.morph")
        again.check()
        np.testing.assert_array_equal(again.pairs, result.pairs)
        for t in TIMES:
            same(again.frame(t), result.frame(t))
        for t in TIMES[1:4] if resample else TIMES[2:3]:
            same(again.resampled_frame(t), result.resampled_frame(t))
    assert not again.has_mesh
    np.testing.assert_array_equal(again.source_to_target, result.source_to_target)
    np.testing.assert_array_equal(again.target_to_source, result.target_to_source)


@pytest.mark.parametrize(
    "settings",
    [
        {"path": "linear", "stagger": "delay", "stagger_overlap": 0.3},
        {"path": "rigid", "stagger": "noise", "stagger_seed": 3},
    ],
)
def test_meshes_have_the_same_bits(settings: dict, tmp_path: Path) -> None:
    delay = np.linspace(0, 1, SIDE * SIDE) if settings["stagger"] == "delay" else None
    dtype = np.float32 if delay is None else np.float64
    result = pointmorph.morph(*sheets(dtype, faces=True, delay=delay), marks(), **settings)
    result.save(tmp_path / "meshes.morph")
    again = pointmorph.open_morph(tmp_path / "meshes.morph")
    assert again.has_mesh
    assert again.has_target_mesh
    for t in TIMES:
        same(again.frame(t), result.frame(t))
        np.testing.assert_array_equal(again.wrapped(t), result.wrapped(t))
        np.testing.assert_array_equal(again.wrapped_target(t), result.wrapped_target(t))
        for side in ("source", "target"):
            np.testing.assert_array_equal(again.vertex_times(t, side), result.vertex_times(t, side))


def test_a_stored_morph_is_a_morph(stored: tuple[pointmorph.Morph, Path], tmp_path: Path) -> None:
    result, path = stored
    again = pointmorph.open_morph(path)
    assert again.report["options"] == result.report["options"]
    assert again.header["origin"] == {"command": ["morph"]}
    assert again.source.name == result.source.name
    assert again.updated(marks()).pairs.shape == result.pairs.shape
    assert again.cracks() == result.cracks()
    values = np.arange(len(again.target), dtype=np.float64)[:, None]
    np.testing.assert_array_equal(again.carrier().values(values), result.carrier().values(values))
    for what in (again.denser, lambda: again.mesh_quality):
        with pytest.raises(pointmorph.CloudError, match="Compute the morph again"):
            what()
    with pytest.raises(ValueError, match="read-only"):
        again.pairs[0, 0] = 1
    # Saved again, it is the same file but for what it says of its making.
    again.save(tmp_path / "again.morph", resample=True)
    third = pointmorph.open_morph(tmp_path / "again.morph")
    assert third.identity == again.identity
    assert third.header["arrays"] == again.header["arrays"]


def test_the_same_morph_makes_the_same_bytes(
    stored: tuple[pointmorph.Morph, Path], tmp_path: Path
) -> None:
    for name in ("one", "two"):
        stored[0].save(tmp_path / f"{name}.morph", resample=True, origin={"command": ["morph"]})
    one, two = ((tmp_path / f"{name}.morph").read_bytes() for name in ("one", "two"))
    assert one == two


def test_numpy_alone_reads_it(stored: tuple[pointmorph.Morph, Path]) -> None:
    result, path = stored
    with np.load(path) as file:  # allow_pickle is False
        names = file.files
        header = json.loads(file["header"].tobytes())
        pairs = file["pairs"]
        half = 0.5 * (file["frame_0/positions"] + file["frame_1/positions"])
    assert set(names) == {"header", *header["arrays"]}
    np.testing.assert_array_equal(pairs, result.pairs)
    straight = 0.5 * (result.frame(0).positions + result.frame(1).positions)
    np.testing.assert_array_equal(half, straight)
    page = (Path(__file__).parents[3] / "docs" / "morph_file.md").read_text(encoding="utf-8")
    for name in names:
        like = name.replace("target/", "source/").replace("frame_1/", "frame_0/")
        assert f"`{like}`" in page, name


def test_arrays_are_mapped_and_aligned(stored: tuple[pointmorph.Morph, Path]) -> None:
    _, path = stored
    file = array_files.ArrayFile(path, "arrays")
    for array in file.arrays.values():
        assert array.ctypes.data % 64 == 0
        assert not array.flags.owndata
        assert not array.flags.writeable


def test_damage_is_noticed_and_named(stored: tuple[pointmorph.Morph, Path], tmp_path: Path) -> None:
    _, path = stored
    whole = path.read_bytes()
    entry = zipfile.ZipFile(path).getinfo("source/images.npy")
    broken = bytearray(whole)
    broken[entry.header_offset + entry.file_size - 8] ^= 4
    (tmp_path / "broken.morph").write_bytes(broken)
    with pytest.raises(pointmorph.FileError, match="source/images"):
        pointmorph.open_morph(tmp_path / "broken.morph").check()
    for length in (0, 10, 400, len(whole) // 2, len(whole) - 1):
        (tmp_path / "short.morph").write_bytes(whole[:length])
        with pytest.raises(pointmorph.FileError):
            pointmorph.open_morph(tmp_path / "short.morph")
    with pytest.raises(pointmorph.FileError, match="No such file"):
        pointmorph.open_morph(tmp_path / "none.morph")


def test_no_byte_of_the_file_can_make_it_crash(
    stored: tuple[pointmorph.Morph, Path], tmp_path: Path
) -> None:
    """Bits flipped all over the file: it is refused with a typed error, or what is read is what
    was written, or the checksums tell."""
    _, path = stored
    whole = bytearray(path.read_bytes())
    random = np.random.default_rng(5)
    places = [*range(0, 600, 5), *range(len(whole) - 3000, len(whole), 31)]
    places += random.integers(0, len(whole), 60).tolist()
    expected = pointmorph.open_morph(path).identity
    opened = None
    for place in places:
        opened = None  # Windows writes no file that is mapped
        changed = bytearray(whole)
        changed[place] ^= 1 << int(random.integers(8))
        (tmp_path / "changed.morph").write_bytes(changed)
        try:
            opened = pointmorph.open_morph(tmp_path / "changed.morph")
            opened.check()
        except pointmorph.FileError:
            continue
        assert opened.identity == expected


def rewritten(path: Path, to: Path, header: dict | None = None, **arrays: object) -> Path:
    """The file with parts of it replaced, and checksums that fit."""
    file = array_files.ArrayFile(path, "arrays")
    kept = {key: value for key, value in file.header.items() if key != "arrays"}
    changed = {**file.arrays, **{name.replace("__", "/"): a for name, a in arrays.items()}}
    changed = {name: array for name, array in changed.items() if array is not None}
    array_files.write(to, {**kept, **(header or {})}, changed)
    return to


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"header": {"version": 2}}, "version 2.*Install that version"),
        ({"header": {"format": "something"}}, "another kind"),
        ({"header": {"names": ["one"]}}, "incomplete header"),
        ({"header": {"options": {"paht": "rigid"}}}, "unknown settings"),
        ({"source__radii": None}, "no source/radii"),
        ({"pairs": np.zeros((4, 3), np.int64)}, "pairs of shape"),
        ({"source__images": np.zeros((4, 3))}, "source/images of shape"),
        ({"frame_1__radii": np.zeros(3, np.float32)}, "frame_1/radii of shape"),
        ({"resampling__times": None}, "no resampling/times"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_files_that_do_not_fit_are_refused(
    stored: tuple[pointmorph.Morph, Path], tmp_path: Path, change: dict, words: str
) -> None:
    path = rewritten(stored[1], tmp_path / "other.morph", **change)
    with pytest.raises(pointmorph.FileError, match=words):
        pointmorph.open_morph(path)


def test_rows_and_numbers_that_cannot_be_are_refused(
    stored: tuple[pointmorph.Morph, Path], tmp_path: Path
) -> None:
    arrays = array_files.ArrayFile(stored[1], "arrays").arrays
    pairs = np.array(arrays["pairs"])
    pairs[3, 1] = 1 << 40
    corners = np.array(arrays["source/corners"])
    corners[5] = -3
    offsets = np.array(arrays["target/face_offsets"])
    offsets[2] = offsets[1] - 1
    plan = np.array(arrays["resampling/pairs"])
    ends = np.array(arrays["source/ends"])
    ends[0, 0] = np.nan
    wrong = {"pairs": pairs, "source__corners": corners, "target__face_offsets": offsets}
    wrong["source__ends"] = ends
    if len(plan):
        plan[0, 0] = len(pairs)
        wrong["resampling__pairs"] = plan
    for name, array in wrong.items():
        path = rewritten(stored[1], tmp_path / f"{name}.morph", **{name: array})
        with pytest.raises(pointmorph.PointmorphError):
            pointmorph.open_morph(path).frame(0.5)


def test_a_chain_is_not_one_morph(tmp_path: Path) -> None:
    flat = pointmorph.Cloud(grid(9), np.tile([0.0, 0, 1], (81, 1)), radii=np.full(81, 0.1))
    rows = np.arange(81)
    part = pointmorph.restore(flat, flat, np.column_stack([rows, rows]))
    with pytest.raises(pointmorph.OptionError, match="each of its parts"):
        Chain([part, part], {}).save(tmp_path / "chain.morph")
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    result = pointmorph.morph(pointmorph.Cloud(grid(9)), pointmorph.Cloud(grid(9, 0.5)))
    with pytest.raises(pointmorph.FileError, match="Choose another folder"):
        result.save(tmp_path / "no" / "such.morph")
    with pytest.raises(pointmorph.Cancelled):
        result.save(tmp_path / "a.morph", resample=True, progress=lambda *_: False)
    assert not list(tmp_path.iterdir())


def test_frames_of_a_stored_morph_are_those_of_the_run(
    stored: tuple[pointmorph.Morph, Path], tmp_path: Path
) -> None:
    """Files as well: made of the file in two parts, in the other order, with any threads."""
    result, path = stored
    (tmp_path / "whole").mkdir()
    (tmp_path / "parts").mkdir()
    times = sequences.even_times(6)
    sequences.write_frames(result, tmp_path / "whole", times, resample=True)
    for which, threads in ((range(3, 6), 1), (range(4), 2)):
        again = pointmorph.open_morph(path, threads=threads)
        sequence = sequences.FrameSequence(again, times, resample=True)
        sequences.FrameRun(sequence, tmp_path / "parts").make(which)
    for k in range(6):
        name = f"frame_{k:04d}.ply"
        one, other = ((tmp_path / folder / name).read_bytes() for folder in ("whole", "parts"))
        assert one == other


def large(path: Path, count: int) -> None:
    """A straight morph of so many pairs, of numbers that need no morphing."""
    random = np.random.default_rng(1)
    clouds = []
    for _ in range(2):
        positions = random.random((count, 3), np.float32)
        normals = np.tile(np.float32([0, 0, 1]), (count, 1))
        clouds.append(pointmorph.Cloud(positions, normals, radii=np.full(count, 0.01, np.float32)))
    rows = np.arange(count)
    maps = clouds[1].positions, clouds[0].positions
    result = pointmorph.restore(*clouds, np.column_stack([rows, rows]), maps, path="linear")
    result.save(path)


def test_opening_takes_as_long_for_a_large_one_as_for_a_small_one(tmp_path: Path) -> None:
    """Nothing is read but the header; and a straight frame asks for nothing but both ends."""
    seconds = {}
    for count in (1_000, 300_000):
        path = tmp_path / f"{count}.morph"
        large(path, count)
        tries = []
        for _ in range(5):
            start = time.process_time()
            opened = pointmorph.open_morph(path)
            tries.append(time.process_time() - start)
        seconds[count] = min(tries)
        opened.frame(0.5)
        assert "_native" not in vars(opened)
    assert seconds[300_000] < 4 * seconds[1_000] + 0.002
