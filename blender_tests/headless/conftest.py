"""The add-on, installed once, and an empty scene for every test."""

import copy
import importlib
import os
import pickle
import sys
from pathlib import Path

import bpy
import pytest

sys.path.insert(0, str(Path(__file__).parent))  # for `scenes`

import installing
import painted_scenes
import scenes

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


@pytest.fixture(autouse=True)
def settings(module):
    """`scene.pointmorph` of an empty scene, where a morph is shown as its points, which go
    straight: so a test knows where they are."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.pointmorph.show_as = "POINTS"
    bpy.context.scene.pointmorph.path = "linear"
    return bpy.context.scene.pointmorph


@pytest.fixture(scope="session")
def remembering(addon):
    """`computation.compute`, which computes nothing twice."""
    compute = addon("core.computation").compute
    known = {}

    def remembered(request, progress, earlier=None):
        before = earlier and (earlier.request.without_looks(), earlier.maps)
        asked = pickle.dumps((request.without_looks(), before))
        if asked not in known:
            known[asked] = compute(request, progress, earlier)
        return copy.deepcopy(known[asked])

    return remembered


@pytest.fixture(autouse=True)
def computed_once(request, addon, monkeypatch, remembering):
    """Tests share what the library computes, but those of the computing, marked `computes`."""
    if not request.node.get_closest_marker("computes"):
        monkeypatch.setattr(addon("data.chains"), "compute", remembering)


@pytest.fixture
def morphed(settings):
    """Source, target and morph object, which is active."""
    return *scenes.pair(), scenes.morph()


@pytest.fixture
def textured(settings):
    """Source and target: one blue, the other with a ramp."""
    return painted_scenes.blue_and_ramp(settings)


@pytest.fixture(scope="session")
def output():
    """A folder for pictures that outlive the tests."""
    folder = Path(os.environ.get("POINTMORPH_OUTPUT", installing.ROOT / "build" / "blender_tests"))
    folder = folder / ".".join(map(str, bpy.app.version[:2]))
    folder.mkdir(parents=True, exist_ok=True)
    return folder
