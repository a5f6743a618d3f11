"""The add-on, installed once, and an empty scene for every test."""

import importlib
import os
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))  # for `scenes`
sys.path.append(str(Path(__file__).parents[2] / "native" / "tests" / "python"))  # for `spelling`

import installing
import painted_scenes
import scenes
import transferring_scenes
from remembering import Memory

# Before pytest imports the tests, and with them `pointmorph`: a packaged add-on brings its own.
MODULE = installing.install()


def pytest_collection_modifyitems(items):
    if reason := os.environ.get("POINTMORPH_NO_RENDERING"):
        for item in items:
            if item.get_closest_marker("renders"):
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def module():
    """Name of the add-on's module."""
    return MODULE


@pytest.fixture(scope="session")
def addon(module):
    """Gives the add-on's files as modules: `addon("data.arrays")`."""
    return lambda name: importlib.import_module(f"{module}.{name}")


def put_in_order():
    """Has an empty scene show a morph as its points, which go straight: so a test knows where they
    are. Returns its settings."""
    settings = bpy.context.scene.pointmorph
    settings.show_as, settings.path = "POINTS", "linear"
    return settings


@pytest.fixture(scope="session")
def known_nodes(addon, tmp_path_factory):
    """A file with an empty scene, and with the groups of nodes that most results have, as the
    add-on makes them."""
    folder = tmp_path_factory.mktemp("nodes")
    groups, start = str(folder / "nodes.blend"), str(folder / "start.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    scenes.pair()
    scenes.morph()
    for make in ("cached_group", "rows_group"):
        getattr(addon("scene.frames_display"), make)(created=lambda block: None)
    bpy.data.libraries.write(groups, set(bpy.data.node_groups))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(groups) as (there, loaded):
        loaded.node_groups = there.node_groups
    for group in bpy.data.node_groups:
        group.use_fake_user = True  # else what nothing uses is not saved
    put_in_order()
    bpy.ops.wm.save_as_mainfile(filepath=start, copy=True)
    return start


@pytest.fixture(autouse=True)
def settings(request, known_nodes):
    """`scene.pointmorph` of an empty scene.

    As after an earlier morph, the file has the groups of nodes, which take most of a small morph's
    time; not where a test is marked `makes_nodes`.
    """
    if request.node.get_closest_marker("makes_nodes"):
        bpy.ops.wm.read_homefile(use_empty=True)
        return put_in_order()
    bpy.ops.wm.read_homefile(filepath=known_nodes)
    for group in bpy.data.node_groups:
        group.use_fake_user = False
    return bpy.context.scene.pointmorph


@pytest.fixture(scope="session")
def memory(tmp_path_factory):
    """What tests leave for each other, here or in the folder that POINTMORPH_COMPUTED names."""
    return Memory(os.environ.get("POINTMORPH_COMPUTED") or tmp_path_factory.mktemp("computed"))


@pytest.fixture(scope="session")
def remembering(addon, memory):
    """`computation.compute`, which computes nothing twice."""
    return memory.remembering(addon("core.computation").compute)


@pytest.fixture(scope="session")
def remembering_finer(addon, memory):
    """`denser_source.compute`, which cuts no source twice."""
    return memory.remembering_finer(addon("data.denser_source").compute)


@pytest.fixture(autouse=True)
def computed_once(request, addon, monkeypatch, remembering, remembering_finer):
    """Tests share what the library computes, but those of the computing, marked `computes`."""
    if not request.node.get_closest_marker("computes"):
        monkeypatch.setattr(addon("data.chains"), "compute", remembering)
        monkeypatch.setattr(addon("data.denser_source"), "compute", remembering_finer)


@pytest.fixture(autouse=True)
def faces_made_once(request, addon, monkeypatch, memory):
    """Tests share the faces through frames, each of which a process makes that first loads
    MeshLab; but those of the making, marked `makes_faces`."""
    if request.node.get_closest_marker("makes_faces"):
        return
    surfaces = addon("operators.bakes").pointmorph.sequences.surfaces
    make = surfaces._reconstructed

    def made(points, normals, depth, stopped):
        question = "faces", points, normals, depth
        return memory.answer(question, lambda: make(points, normals, depth, stopped))

    monkeypatch.setattr(surfaces, "_reconstructed", made)


@pytest.fixture
def starts(addon, monkeypatch):
    """Of every computation from now on: how many points the maps have that it starts from, or
    None."""
    chains = addon("data.chains")
    compute, found = chains.compute, []

    def computed(request, progress, earlier=None):
        found.append(earlier and [len(places) for places in earlier.start_for(request)])
        return compute(request, progress, earlier)

    monkeypatch.setattr(chains, "compute", computed)
    return found


@pytest.fixture
def morphed(settings):
    """Source, target and morph object, which is active."""
    return *scenes.pair(), scenes.morph()


@pytest.fixture
def textured(settings):
    """Source and target: one blue, the other with a ramp."""
    return painted_scenes.blue_and_ramp(settings)


@pytest.fixture
def turned(settings):
    """Source, target and a mesh that goes exactly from one to the other, turned and enlarged."""
    return transferring_scenes.turned_pair(settings)


@pytest.fixture(scope="session")
def output():
    """A folder for pictures that outlive the tests."""
    folder = Path(os.environ.get("POINTMORPH_OUTPUT", installing.ROOT / "build" / "blender_tests"))
    folder = folder / ".".join(map(str, bpy.app.version[:2]))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture
def mirrored(settings):
    """A source that a modifier doubles, with a material, a UV map and weights; and a target."""
    settings.show_as = "MESH"
    positions, faces = scenes.patch(8)
    source = scenes.add_mesh("Half", positions + np.array([1, 0, 0], np.float32), faces)
    source.location = (1, 2, 3)
    source.data.materials.append(bpy.data.materials.new("Skin"))
    source.data.uv_layers.new(name="Layout")
    scenes.add_group(source, "bone", {3: 0.5})
    source.modifiers.new("Twice", "MIRROR").use_mirror_merge = False
    target = scenes.add_mesh("Dune", *scenes.patch(9, bump=0.8))
    scenes.pick(source, target)
    settings.domain = "disk"
    bpy.context.view_layer.update()
    return source
