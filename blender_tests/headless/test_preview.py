"""The coarse morph that is shown until the whole one is there."""

import bpy
import numpy as np
import pointmorph
import pytest
import scenes


def request(addon, settings, side=150):
    source, _ = scenes.pair(side, side - 20)
    return source, addon("scene.panel_request").read_request(bpy.context)


def test_a_thinned_shape_is_even_and_keeps_the_marks(addon, settings):
    preview = addon("core.preview")
    _, whole = request(addon, settings)
    thinned = preview.thin(whole)
    assert preview.is_worth_it(whole)
    assert not preview.is_worth_it(thinned)
    for side, name in enumerate(("source", "target")):
        full, few = getattr(whole, name), getattr(thinned, name)
        assert 1500 < len(few.positions) < 6000
        assert len(few.positions) < len(full.positions)
        for feature, pair in whole.features.items():
            row = thinned.features[feature][side]
            assert np.array_equal(few.positions[row], full.positions[pair[side]])
        # No hole: every point has one of the few nearby.
        gaps = pointmorph.Cloud(few.positions)
        assert len(gaps.positions) == len(few.positions)
        sample = full.positions[::97]
        apart = np.linalg.norm(sample[:, None] - few.positions[None], axis=2).min(axis=1)
        assert apart.max() < 0.15


def test_curves_and_regions_are_thinned_too(addon, settings):
    side = 150
    source, target = scenes.pair(side, side)
    for obj in (source, target):
        row = side // 3 * side
        scenes.add_group(obj, "pm.ridge", dict.fromkeys(range(row + 5, row + side - 5), 1.0))
        patch = [r for r in range(side * side) if r % side < 40 and r // side > side - 40]
        scenes.add_group(obj, "pm.corner", dict.fromkeys(patch, 0.5))
    whole = addon("scene.panel_request").read_request(bpy.context)
    thinned = addon("core.preview").thin(whole)
    for name in ("ridge", "corner"):
        full, few = whole.features[name], thinned.features[name]
        assert few.kind == full.kind
        for end in (0, 1):
            shape = (thinned.source, thinned.target)[end]
            before = (whole.source, whole.target)[end]
            assert 2 <= len(few.rows(end)) < len(full.rows(end))
            old = before.positions[full.rows(end)]
            new = shape.positions[few.rows(end)]
            assert all((old == place).all(axis=1).any() for place in new)
    told = []

    def tell(stage, fraction):
        told.append((stage, fraction))
        return True

    outcome = addon("core.preview").compute(whole, tell)
    assert outcome is not None
    # A single stage, which moves and never goes back.
    assert {stage for stage, _ in told} == {"preview"}
    fractions = np.array([fraction for _, fraction in told])
    assert (np.diff(fractions) >= 0.0).all()
    assert 0.8 < fractions[-1] <= 1.0
    assert len(np.unique(fractions.round(2))) > 3  # how many there are depends on the time it takes
    assert len(outcome.source.rows) < len(whole.source.positions)


def test_what_cannot_be_previewed_is_not(addon, settings):
    _, whole = request(addon, settings, side=60)
    flat = np.zeros_like(whole.source.positions)
    broken = type(whole)(
        **{**vars(whole), "source": type(whole.source)(**{**vars(whole.source), "positions": flat})}
    )
    assert addon("core.preview").compute(broken, lambda stage, fraction: True) is None


@pytest.mark.makes_nodes
def test_it_comes_and_goes_without_a_trace(addon, settings):
    previewing = addon("scene.preview_object")
    source, whole = request(addon, settings)
    before = scenes.data_blocks()
    outcome = addon("core.preview").compute(whole, lambda stage, fraction: True)
    shapes = [source, settings.target]
    provenance = addon("scene.morph_builder").Provenance(shapes, np.zeros(3), np.eye(4))
    name = previewing.show(bpy.context, outcome, "Hill to Dune", provenance)
    obj = bpy.data.objects[name]
    assert obj.pointmorph.is_preview
    obj.data.shape_keys.key_blocks["Morph"].value = 0.25
    assert previewing.remove(name) == 0.25
    assert scenes.data_blocks() == before
    assert previewing.remove(name) == 0.0  # undone meanwhile
    previewing.show(bpy.context, outcome, "Hill to Dune", provenance)
    previewing.remove_left_over()
    assert scenes.data_blocks() == before


def test_a_result_is_never_taken_for_a_preview(addon, settings):
    scenes.pair()
    bpy.ops.pointmorph.morph()
    addon("scene.preview_object").remove("Hill to Dune")
    addon("scene.preview_object").remove_left_over()
    assert "Hill to Dune" in bpy.data.objects
