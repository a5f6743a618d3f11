"""Bakes that were stopped go on where they were, and end as if nothing had been."""

import bpy
import numpy as np
import pointmorph
import pytest
from pointmorph import sequences
from scenes import attribute, baked_frames, coordinates, data_blocks
from test_frames import (  # noqa: F401  (torn is a fixture)
    FILES,
    bake,
    can_write,
    geometry,
    read_back,
    torn,
)

COUNT = 9
CACHE = "Whole_to_Torn_Frames.pc2"
KINDS = ["SCENE", *FILES]


@pytest.fixture
def made(monkeypatch):
    """The frames that are computed, as a list; a number in `made.limit` ends a bake after that
    many."""

    class Made(list):
        limit = None

    made, before = Made(), sequences.FrameSequence.frame

    def frame(self, k, stopped):
        if made.limit is not None and len(made) >= made.limit:
            raise pointmorph.Cancelled("The frames were canceled.")
        made.append(k)
        return before(self, k, stopped)

    monkeypatch.setattr(sequences.FrameSequence, "frame", frame)
    return made


def interrupted(made, **options):
    made.clear()
    made.limit = 4
    with pytest.raises(RuntimeError, match="canceled"):
        bake(**options)
    assert len(made) == 4
    made.clear()
    made.limit = None


def file_frames(kind, path):
    obj = read_back(kind, path)
    found = []
    for number in range(1, COUNT + 1):
        data = geometry(obj, number)
        points = data.points if kind == "USD" else data.vertices
        names = [a.name for a in data.attributes if not a.name.startswith(".")]
        read = {n: attribute(data, n) for n in names if n not in {"position", "radius"}}
        found.append({"positions": coordinates(points), **read})
    bpy.data.objects.remove(obj)
    return found


def assert_equal(one, other):
    assert len(one) == len(other) == COUNT
    for a, b in zip(one, other, strict=True):
        assert a.keys() == b.keys()
        for name in a:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bake_that_was_stopped_goes_on(torn, tmp_path, made, kind):  # noqa: F811
    if kind != "SCENE" and not can_write(kind, faces=False):
        pytest.skip(f"this Blender writes no {kind}")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    torn = bpy.data.objects["Whole to Torn"]
    before = data_blocks()
    out = tmp_path / "out"
    options = {"format": kind, "directory": str(out)}
    interrupted(made, **options)
    assert data_blocks() == before
    store = (
        tmp_path / "blendcache_shot" / "Whole_to_Torn.frames"
        if kind == "SCENE"
        else out / f"{FILES[kind]}.frames"
    )
    kept = {path.name for path in store.glob("*.npz")}
    assert 0 < len(kept) <= 4

    assert bake(**options) == {"FINISHED"}
    assert len(made) == COUNT - len(kept)
    assert not kept & {f"frame_{k + 1:04d}.npz" for k in made}
    assert not store.exists()
    cache = tmp_path / "blendcache_shot"
    kept = {path.name for path in cache.iterdir()} if cache.exists() else set()
    assert kept == ({CACHE} if kind == "SCENE" else set())

    def result():
        if kind == "SCENE":
            return baked_frames(bpy.context.view_layer.objects.active)
        return file_frames(kind, out / FILES[kind])

    resumed = result()
    made.clear()
    bpy.context.view_layer.objects.active = torn
    assert bake(**options) == {"FINISHED"}
    assert len(made) == COUNT
    assert_equal(resumed, result())


def test_another_request_starts_over(torn, tmp_path, made):  # noqa: F811
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    interrupted(made)
    assert bake(easing="SMOOTH") == {"FINISHED"}
    assert len(made) == COUNT
    assert [path.name for path in (tmp_path / "blendcache_shot").iterdir()] == [CACHE]


def test_what_others_keep_beside_it_stays(torn, tmp_path, made):  # noqa: F811
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    cache = tmp_path / "blendcache_shot"
    cache.mkdir()
    (cache / "cloth.bphys").touch()
    interrupted(made)
    assert bake() == {"FINISHED"}
    assert sorted(path.name for path in cache.iterdir()) == [CACHE, "cloth.bphys"]


def test_a_file_that_was_never_saved(torn, made):  # noqa: F811
    interrupted(made)
    made.clear()
    assert bake() == {"FINISHED"}
    assert len(made) < COUNT
