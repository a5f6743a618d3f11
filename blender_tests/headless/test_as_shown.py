"""What modifiers make of a source: said to be left out, or taken as shown."""

import bpy
import numpy as np
import pytest
from scenes import add_group, add_mesh, coordinates, error_of, mark, morph, patch, pick


@pytest.fixture
def mirrored(settings):
    """A source that a modifier doubles, with a material, a UV map and weights; and a target."""
    settings.show_as = "MESH"
    positions, faces = patch(8)
    source = add_mesh("Half", positions + np.array([1, 0, 0], np.float32), faces)
    source.location = (1, 2, 3)
    source.data.materials.append(bpy.data.materials.new("Skin"))
    source.data.uv_layers.new(name="Layout")
    add_group(source, "bone", {3: 0.5})
    source.modifiers.new("Twice", "MIRROR").use_mirror_merge = False
    target = add_mesh("Dune", *patch(9, bump=0.8))
    pick(source, target)
    settings.domain = "disk"
    bpy.context.view_layer.update()
    return source


def test_what_is_left_out_is_said(addon, mirrored):
    known = addon("scene.as_shown")
    assert known.left_out(mirrored) == ["Twice"]
    assert known.vertices_shown(bpy.context.view_layer, mirrored) == 128
    mirrored.modifiers[0].show_viewport = False
    assert known.left_out(mirrored) == []
    mirrored.shape_key_add(name="Basis")
    key = mirrored.shape_key_add(name="Up")
    key.value = 0.0
    assert known.left_out(mirrored) == []
    key.value = 0.5
    assert known.left_out(mirrored) == ["shape keys"]
    assert known.left_out(None) == []


def test_the_source_as_shown_is_morphed(mirrored, settings):
    assert bpy.ops.pointmorph.use_as_shown() == {"FINISHED"}
    copy = settings.source
    assert copy.name == "Half as Shown"
    assert len(copy.data.vertices) == 128
    assert not copy.modifiers
    assert copy.material_slots[0].material.name == "Skin"
    assert copy.data.uv_layers[0].name == "Layout"
    assert [group.name for group in copy.vertex_groups] == ["bone"]
    assert [v.index for v in copy.data.vertices if v.groups] == [3, 67]
    assert tuple(copy.location) == (1, 2, 3)
    assert mirrored.hide_get()
    assert len(mirrored.modifiers) == 1
    assert len(mirrored.data.vertices) == 64
    assert "has no modifiers" in error_of(bpy.ops.pointmorph.use_as_shown)


def test_marks_come_along(mirrored, settings):
    mark(mirrored, "peak", 1, 0)
    mark(settings.target, "peak", 0, 0)
    mirrored.modifiers.clear()
    mirrored.modifiers.new("Bend", "CAST").factor = 0.3
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.use_as_shown()
    assert [f.name for f in settings.features if f.on_source and f.on_target] == ["peak"]
    shown = morph()
    evaluated = mirrored.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    np.testing.assert_allclose(
        coordinates(shown.data.vertices), coordinates(evaluated.vertices), atol=1e-6
    )
