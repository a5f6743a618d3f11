"""Files in and out, and what faces say."""

from __future__ import annotations

import gc
import os
import random
import signal
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from plyfile import PlyData
from pointmorph import formats, meshes
from pointmorph.formats import obj
from pointmorph.storage import files
from shapes import grid, grid_faces


def write_frame(path: Path, count: int = 50, dtype: type = np.float32) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(3)
    positions, normals = rng.random((2, count, 3)).astype(dtype)
    colors = (rng.integers(0, 256, (count, 4)) / 255).astype(np.float32)
    radii = rng.random(count).astype(dtype)
    formats.write_ply(path, positions, normals, colors, radii)
    return positions, normals, colors, radii


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_ply_comes_back_bit_for_bit(tmp_path: Path, dtype: type) -> None:
    written = write_frame(tmp_path / "a.ply", dtype=dtype)
    shape = formats.read(tmp_path / "a.ply")
    for before, after in zip(
        written, (shape.positions, shape.normals, shape.colors, shape.radii), strict=True
    ):
        assert after is not None
        assert before.astype(after.dtype).tobytes() == after.tobytes()
    names = PlyData.read(str(tmp_path / "a.ply"))["vertex"].data.dtype.names
    assert names == ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "radius")


def test_mesh_formats_keep_the_rows(tmp_path: Path) -> None:
    positions, faces = grid(5, 0.4, np.float64), grid_faces(5)
    positions = np.vstack([positions, [[9.0, 9.0, 9.0]]])  # a vertex without a face
    (tmp_path / "m.off").write_text(
        f"OFF\n{len(positions)} {len(faces)} 0\n"
        + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in positions.tolist())
        + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
    )
    (tmp_path / "m.obj").write_text(
        "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in positions.tolist())
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    for name in ("m.off", "m.obj"):
        shape = formats.read(tmp_path / name)
        np.testing.assert_array_equal(shape.positions, positions)
        assert shape.faces is not None
        np.testing.assert_array_equal(np.sort(shape.faces, axis=None), np.sort(faces, axis=None))


def test_obj_corners_with_several_normals_keep_the_rows(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nvt 0 0\nvt 1 0\n"
        "f 1/1/1 2/2/1 3/1/1\nf 1/2/2 3/2/2 4/1/2\n"
    )
    shape = formats.read(tmp_path / "m.obj")
    np.testing.assert_array_equal(shape.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


FOUR = "v 0 0 0\nv 1 0 0\nv 1 1e-1 0\nv 0 1 .5\n"
CORNERS = "f 1/1/1 2/2/1 3/1/1\nf 1/1/1 3/1/1 4/2/1\n"
UV = "vt 0 0\nvt 1 0\nvn 0 0 1\n"


@pytest.mark.parametrize(
    ("content", "plain"),
    [
        (FOUR + "f 1 2 3\nf 1 3 4", True),
        ("# made by hand\r\n" + FOUR.replace("\n", "\r\n") + "s off\r\nf 1 2  4 \r\n", True),
        (FOUR + "f 1 2 3 4\nf 4 3 2 1\n", True),
        (FOUR + "v 5 5 5\nf 1 2 3 4\nf 2 3 4\nf 1 2 3 4 5\nf 2 1 3\n", True),
        ("mtllib a.mtl\no A\n" + FOUR + UV + "usemtl a\n" + CORNERS, True),
        (FOUR + UV + "f 1/1 2/2 3/1\nf 1/1 3/2 4/2 2/1\n", True),
        (FOUR + UV + "f 1//1 2//1 3//1\nf 1//1 3//1 4//1\n", True),
        (FOUR + "v 9 9 9\nf 1 2 3\n", True),  # a vertex without a face
        (FOUR + UV + "f 1/1 2/2 3/1\n", True),
        (FOUR + "f 1 2 3\nusemtl b\nf 1 3 4\n", True),
        (FOUR + "f -1 -2 -3\n", False),
        (FOUR + "f 1 2 3 4 4\n", True),
        (FOUR + "f 1 2 3\nl 1 2\n", False),
        (FOUR + "f 1 2 3 \\\n4\n", False),
        (FOUR + UV + "f 1/1 2 3\n", False),
        (FOUR + UV + "f 1//1 2/1/1 3/1/1 4\n", False),
        ("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\n", False),
        ("v 0 0 0 1\nv 1 0 0 1\nv 1 1 0 1\nf 1 2 3\n", False),
    ],
)  # fmt: skip
def test_an_obj_has_the_same_rows_as_a_whole_and_line_by_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str, plain: bool
) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(content.encode())
    assert (obj.read(path) is not None) == plain
    ours = formats.read(path)
    monkeypatch.setattr(obj, "read", lambda path: None)
    theirs = formats.read(path)
    assert vars(ours).keys() == vars(theirs).keys()
    for name, values in vars(theirs).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(getattr(ours, name), values)
            assert getattr(ours, name).dtype == values.dtype
        else:
            assert getattr(ours, name) == values


@pytest.mark.parametrize(
    "content",
    [FOUR, FOUR + "f 1 2 9\n", FOUR + "f 1 x 3\n", "v 0 0\nf 1 1 1\n", "v a b c\nf 1 1 1\n"],
)
def test_an_obj_that_is_no_mesh_is_read_line_by_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.obj").write_text(content)
    assert obj.read(tmp_path / "a.obj") is None


def test_an_obj_keeps_its_rows_whatever_its_faces_say(tmp_path: Path) -> None:
    """Materials, objects, several UVs and normals at a vertex, vertices without a face."""
    (tmp_path / "a.obj").write_text(
        "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 0\nv 8 8 8\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nvn 0 1 0\n"
        "o A\nusemtl red\nf 2/1/1 3/2/1 4/3/1 5/1/1\nusemtl blue\nf -6/3/2 -5/1/2 -2/2/2\n"
        "o B\ng b\nf 4 5 6 \\\n 2 3\nf 2 3\nl 1 7\n"
    )
    shape = formats.read(tmp_path / "a.obj")
    assert shape.positions[:, 0].tolist() == [9, 0, 1, 1, 0, 2, 8]
    assert shape.faces is not None
    quad, five = shape.faces[[0, 1]], shape.faces[[3, 4, 5]]
    assert sorted(quad.ravel().tolist()) == [1, 2, 2, 3, 4, 4]
    assert shape.faces[2].tolist() == [1, 2, 5]
    assert set(five.ravel().tolist()) == {1, 2, 3, 4, 5}


COMB = [
    (0, 0),
    (8, 0),
    (8, 5),
    (7, 5),
    (7, 1),
    (5, 1),
    (5, 5),
    (3, 5),
    (3, 1),
    (1, 1),
    (1, 5),
    (0, 5),
]


@pytest.mark.parametrize("name", ["a.obj", "b.obj", "a.ply"])
def test_a_polygon_that_is_not_convex_keeps_its_outline(tmp_path: Path, name: str) -> None:
    if name.endswith(".obj"):
        rows = [f"v {x} {y} 1" for x, y in COMB] + ["f " + " ".join(map(str, range(1, 13)))]
        rows += ["l 1 2"] if name == "b.obj" else []  # is read line by line
    else:
        head = "ply\nformat ascii 1.0\nelement vertex 12\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz")
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header"
        rows = [head, *(f"{x} {y} 1" for x, y in COMB), "12 " + " ".join(map(str, range(12)))]
    (tmp_path / name).write_text("\n".join(rows) + "\n")
    shape = formats.read(tmp_path / name)
    assert shape.faces is not None
    places = shape.positions[shape.faces][..., :2]
    (ux, uy), (vx, vy) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
    areas = (ux * vy - uy * vx) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(8 + 4 + 8 + 4)  # the back and three teeth


@pytest.mark.parametrize(
    ("offsets", "corners", "columns", "message"),
    [
        ([0, 900000], [0, 1, 2, 3], 3, "offsets: expected rising numbers of 0 to 4"),
        ([-4, 4], [0, 1, 2, 3], 3, "offsets: "),
        ([0, 4, 1, 4], [0, 1, 2, 3], 3, "offsets: "),
        ([], [0, 1, 2, 3], 3, "offsets: "),
        ([0, 4], [0, 1, 2, 9], 3, "rows 0 to 4, found 0 to 9"),
        ([0, 4], [0, 1, 2, 4], 2, "a table with 3 columns"),
    ],
)
def test_polygons_that_are_none_are_refused(
    offsets: list[int], corners: list[int], columns: int, message: str
) -> None:
    with pytest.raises(pointmorph.CloudError, match=message):
        meshes.triangulate(np.zeros((5, columns)), np.array(offsets, np.int64), np.array(corners))


@pytest.mark.parametrize("number", ["nan", "inf", "1e300"])
def test_a_polygon_with_a_corner_nowhere_is_read(tmp_path: Path, number: str) -> None:
    rows = [f"v {number if k == 7 else k} {k * k} 0" for k in range(40)]
    (tmp_path / "a.obj").write_text("\n".join([*rows, "f " + " ".join(map(str, range(1, 41)))]))
    shape = formats.read(tmp_path / "a.obj")
    assert shape.faces is not None
    assert shape.faces.shape == (38, 3)
    assert set(shape.faces.ravel().tolist()) == set(range(40))


@pytest.mark.parametrize("top", [1, 255])
def test_an_obj_has_colors_of_vertices(tmp_path: Path, top: int) -> None:
    (tmp_path / "a.obj").write_text(f"v 0 0 0 {top} 0 0\nv 1 0 0 0 {top} 0\nv 1 1 0 0 0 0\n")
    shape = formats.read(tmp_path / "a.obj")
    assert shape.colors is not None
    assert shape.colors.tolist() == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 0, 1]]
    assert shape.faces is None


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("v 0 0\n", "in line 1: fewer than three coordinates"),
        ("v 0 0 0\n\nf 1 x 1\n", "in line 3: .*'x'"),
        ("v 0 0 0\nf 0 1 1\n", "in line 2: a face with vertex 0"),
        (FOUR + "f 1 2 9\n", "rows 0 to 3, found 0 to 8"),
    ],
)
def test_a_broken_obj_is_refused_with_the_line(tmp_path: Path, content: str, found: str) -> None:
    (tmp_path / "a.obj").write_text(content)
    with pytest.raises(pointmorph.FileError, match=found):
        formats.read(tmp_path / "a.obj")


@pytest.mark.parametrize("more", ["", "usemtl b\nf -1 -2 -3\n"])
def test_an_obj_is_read_without_trimesh(tmp_path: Path, more: str) -> None:
    (tmp_path / "a.obj").write_text(FOUR + "f 1 2 3\n" + more)
    code = "import sys; from pointmorph import formats; formats.read(sys.argv[1]); "
    code += "sys.exit('trimesh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.obj")]).returncode == 0


def test_text_with_normals(tmp_path: Path) -> None:
    rows = np.random.default_rng(0).random((20, 6))
    np.savetxt(tmp_path / "a.xyz", rows, header="x y z nx ny nz")
    shape = formats.read(tmp_path / "a.xyz")
    np.testing.assert_allclose(shape.positions, rows[:, :3])
    np.testing.assert_allclose(shape.normals, rows[:, 3:])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.ply", None),
        ("a.docx", b"x"),
        ("empty.ply", b""),
        ("junk.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nend_header\n1 2\n"),
        ("empty.off", b""),
        ("junk.obj", b"hello\n"),
        ("junk.xyz", b"a b c\n"),
        ("flat.xyz", b"1 2\n3 4\n"),
    ],
)
def test_unreadable_files_are_refused_in_words(
    tmp_path: Path, name: str, content: bytes | None
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(pointmorph.FileError) as caught:
        formats.read(tmp_path / name)
    assert name in str(caught.value)


def test_a_file_that_may_not_be_read_is_not_called_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied", "a.xyz")

    (tmp_path / "a.xyz").write_bytes(b"1 2 3\n")
    monkeypatch.setattr("pointmorph.formats.table.check_claims", refuse)
    with pytest.raises(pointmorph.FileError, match=r"found Permission denied\. Check the path\."):
        formats.read(tmp_path / "a.xyz")


def test_too_little_memory_is_not_called_a_broken_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(*_: object) -> None:
        raise MemoryError

    (tmp_path / "a.xyz").write_bytes(b"1 2 3\n")
    monkeypatch.setattr("pointmorph.formats.table.check_claims", fill)
    with pytest.raises(pointmorph.FileError, match="too little memory"):
        formats.read(tmp_path / "a.xyz")


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_frame(path)
    before = path.read_bytes()

    def write_half() -> None:
        with files.whole_file(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.ply"]


def test_a_full_disk_is_said(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")

    def write() -> None:
        with files.whole_file(tmp_path / "a") as file:
            os.dup2(os.open("/dev/full", os.O_WRONLY), file.fileno())
            file.write(b"x" * 100)

    with pytest.raises(pointmorph.FileError, match="space"):
        write()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no timers of this kind")
def test_an_interrupt_at_any_moment_leaves_nothing(tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    files.write_bytes(tmp_path / "0", b"whole")
    chance = random.Random(1)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for _ in range(1000):
            with suppress(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-6, 4e-4))
                for number in range(1000):
                    files.write_bytes(tmp_path / f"{number % 5}", b"whole")
            if list(tmp_path.glob(".*")):
                gc.collect()  # an exception may hold the file until now
            assert not [path.name for path in tmp_path.glob(".*")]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {b"whole"}


def test_a_missing_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(pointmorph.FileError, match="folder"):
        files.write_bytes(tmp_path / "no" / "a", b"x")


def test_written_files_have_the_usual_rights(tmp_path: Path) -> None:
    files.write_bytes(tmp_path / "a", b"x")
    (tmp_path / "b").write_bytes(b"x")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE(
        (tmp_path / "b").stat().st_mode
    )


WRITER = """
import sys, time
from pointmorph.formats import obj
from pointmorph.storage import files
with files.whole_file(sys.argv[1]) as file:
    file.write(b"half")
    file.flush()
    print("writing", flush=True)
    time.sleep(20)
"""


def writing(path: Path) -> subprocess.Popen[bytes]:
    """A process that is in the middle of writing a file."""
    process = subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline().split() == [b"writing"]
    return process


def test_what_a_killed_process_left_goes_with_the_next_run(tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("there it is taken for one that is being written for a while")
    with writing(tmp_path / "a.ply") as alive, writing(tmp_path / "b.ply") as killed:
        (tmp_path / ".mine.part").touch()
        assert len(os.listdir(tmp_path)) == 3
        killed.kill()
        killed.wait()
        files.make_folder(tmp_path)
        kept = {".a.ply.0.pointmorph-part", ".mine.part"}
        assert set(os.listdir(tmp_path)) == kept
        files.write_bytes(tmp_path / "a.ply", b"whole")  # also while another one writes it
        assert set(os.listdir(tmp_path)) == kept | {"a.ply"}
        alive.kill()
        alive.wait()
        files.write_bytes(tmp_path / "a.ply", b"new")
        assert set(os.listdir(tmp_path)) == {"a.ply", ".mine.part"}
        assert (tmp_path / "a.ply").read_bytes() == b"new"


def test_threads_write_one_file_side_by_side(tmp_path: Path) -> None:
    def write(letter: str) -> None:
        for _ in range(8):
            files.write_bytes(tmp_path / "a", letter.encode() * 100_000)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, "abcd"))
    assert os.listdir(tmp_path) == ["a"]
    assert len(set((tmp_path / "a").read_bytes())) == 1


def test_a_link_with_the_name_of_a_part_leads_nowhere(tmp_path: Path) -> None:
    (tmp_path / "other").write_bytes(b"mine")
    try:
        (tmp_path / ".a.0.pointmorph-part").symlink_to(tmp_path / "other")
    except OSError:
        pytest.skip("no links here")
    files.write_bytes(tmp_path / "a", b"x")
    assert (tmp_path / "other").read_bytes() == b"mine"


def test_long_names_are_prefixed_on_windows() -> None:
    name = Path("a" * 300)
    if sys.platform != "win32":
        assert files.reachable(name) == name
    else:
        assert str(files.reachable(name)).startswith("\\\\?\\")
        assert files.reachable("short") == Path("short")


def test_folders_with_long_names_and_umlauts_hold_files(tmp_path: Path) -> None:
    folder = tmp_path.joinpath(*(["ordner mit ä und ß " + "x" * 40] * 6))
    files.make_folder(folder)
    files.write_bytes(folder / "größe.ply", b"1")
    files.write_bytes(folder / "größe.ply", b"2")
    assert files.reachable(folder / "größe.ply").read_bytes() == b"2"


def test_boundary_of_a_grid_is_its_border() -> None:
    loops = meshes.boundary_loops(grid_faces(9), 81)
    assert len(loops) == 1
    border = {i for i in range(81) if i // 9 in (0, 8) or i % 9 in (0, 8)}
    assert set(loops[0].tolist()) == border
    steps = np.abs(loops[0] - np.roll(loops[0], -1))
    assert set(steps.tolist()) <= {1, 9}


def test_boundary_with_holes_mixed_polygons_and_windings() -> None:
    faces = [face.tolist() for face in grid_faces(9)]
    faces = [f for f in faces if 40 not in f]  # the middle is a hole
    faces = [f[::-1] if i % 3 == 0 else f for i, f in enumerate(faces)]
    loops = meshes.boundary_loops(faces, 81)
    assert [len(loop) for loop in loops] == [32, 6]


def test_boundaries_that_meet_in_a_vertex_are_split() -> None:
    loops = meshes.boundary_loops([[0, 1, 2], [0, 3, 4]], 5)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [[0, 1, 2], [0, 3, 4]]


def test_boundaries_that_all_meet_in_a_vertex_take_no_longer_than_others() -> None:
    count = 20000
    apart = np.arange(3 * count).reshape(-1, 3)
    together = apart - np.arange(count)[:, None]
    together[:, 0] = 0

    def seconds(faces: np.ndarray) -> float:
        tries = []
        for _ in range(3):
            start = time.process_time()
            assert len(meshes.boundary_loops(faces, 3 * count)) == count
            tries.append(time.process_time() - start)
        return min(tries)

    assert seconds(together) < 8 * seconds(apart)  # 35 times where each is looked for among all


def test_closed_and_empty_meshes_have_no_boundary() -> None:
    tetrahedron = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    assert meshes.boundary_loops(tetrahedron, 4) == []
    assert meshes.boundary_loops([], 0) == []
    assert meshes.boundary_loops(np.empty((0, 3), int), 0) == []


def test_parts_are_what_faces_join_also_over_seams() -> None:
    # Two triangles that share a place but no vertex, one apart, and two vertices without a face.
    places = np.array(
        [
            *([0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]),
            *([9, 0, 0], [9, 1, 0], [8, 0, 0], [8.5, 0.1, 0], [0.1, 0.1, 0]),
        ],
        np.float32,
    )
    labels = meshes.parts([[0, 1, 2], [3, 4, 5], [6, 7, 8]], places)
    assert len(set(labels[[0, 1, 2, 3, 4, 5, 10]].tolist())) == 1
    assert len(set(labels[[6, 7, 8, 9]].tolist())) == 1
    assert labels[0] != labels[6]
    assert meshes.parts(np.empty((0, 3), int), places).tolist() == [0, 1, 2, 1, *range(4, 11)]


def test_vertex_normals_of_a_sphere_point_outwards() -> None:
    import trimesh

    sphere = trimesh.creation.icosphere(3)
    normals = meshes.vertex_normals(sphere.vertices, sphere.faces)
    np.testing.assert_allclose(normals, sphere.vertices, atol=0.02)
