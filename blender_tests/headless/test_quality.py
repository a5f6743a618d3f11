"""How good a morph is: the attribute, the colours that show it, and the places with advice."""

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pointmorph
import pytest
from panel_drawing import drawing_context
from pointmorph.morphs.verdicts import GRADES
from scenes import (
    add_attribute,
    attribute,
    data_blocks,
    groups,
    key,
    mark,
    morph,
    pair,
    patch,
    read,
    select,
    triangles,
)


def bad_pair():
    """A pair with one feature far off on the target."""
    source, target = pair(30, 26)
    mark(source, "off", -0.6, -0.6)
    mark(target, "off", 0.3, -0.8)
    return source, target


def shown_colors(addon, obj):
    """Colours of the points that are drawn, as point clouds or as discs."""
    names = addon("data.attribute_names")
    graph = bpy.context.evaluated_depsgraph_get()
    for instance in graph.object_instances:
        if instance.object.type == "POINTCLOUD":
            return attribute(instance.object.data, names.COLOR)
    mesh = obj.evaluated_get(graph).to_mesh()
    colors = attribute(mesh, names.COLOR)
    return colors.reshape(len(obj.data.vertices), -1, 4)[:, 0]


def test_the_attribute_is_the_worse_end_of_every_pair(settings):
    objects = bad_pair()
    obj = morph()
    distortion = attribute(obj.data, "distortion")
    assert (distortion >= 0).all()
    clouds = [
        pointmorph.Cloud(
            read(shape.data.vertices, "co", 3),
            np.array([v.normal for v in shape.data.vertices], np.float32),
            faces=triangles(shape.data),
        )
        for shape in objects
    ]
    report = json.loads(obj.pointmorph.report)
    pairs = [attribute(obj.data, f"{side}_row") for side in ("source", "target")]
    rows = {
        name[3:]: tuple(next(iter(groups(shape)[name])) for shape in objects)
        for name in groups(objects[0])
    }
    quality = pointmorph.morph(*clouds, rows, domain="disk").quality
    expected = np.maximum(quality.source.distortion[pairs[0]], quality.target.distortion[pairs[1]])
    np.testing.assert_allclose(distortion, expected, atol=1e-4)
    assert report["quality"]["source_to_target"]["coverage"] > 0.9


def test_one_click_colors_by_distortion_and_another_restores(addon, settings):
    source, target = bad_pair()
    for shape in (source, target):
        colors = np.tile((0.1, 0.2, 0.3, 1.0), (len(shape.data.vertices), 1))
        item = add_attribute(shape.data, "Col", "FLOAT_COLOR", colors)
        shape.data.color_attributes.active_color = item
    obj = morph()
    display = addon("scene.points_display")
    before = shown_colors(addon, obj)
    np.testing.assert_allclose(before, np.tile((0.1, 0.2, 0.3, 1.0), (len(before), 1)), rtol=1e-5)
    modifier = obj.modifiers[display.MODIFIER]
    versions = addon("data.versions")
    names = ("Discs", "Spheres", "Radius Scale", *display.SHOW.values())
    inputs = {name: versions.input_value(modifier, name) for name in names}

    assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
    assert display.shows(obj, "distortion")
    colors = shown_colors(addon, obj)
    distortion = attribute(obj.data, "distortion")
    blue, yellow = np.array([0.05, 0.25, 0.9]), np.array([1.0, 0.85, 0.1])
    share = np.minimum(distortion, 1.0)[:, None]
    low = distortion < 1.0
    np.testing.assert_allclose(
        colors[low, :3], ((1 - share) * blue + share * yellow)[low], atol=0.01
    )
    assert (colors[distortion >= 2.0, 1] < 0.1).all()
    worst, best = distortion.argmax(), distortion.argmin()
    assert colors[worst, 0] > colors[best, 0]

    assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
    assert not display.shows(obj, "distortion")
    np.testing.assert_array_equal(shown_colors(addon, obj), before)
    for name, value in inputs.items():
        assert versions.input_value(modifier, name) == value, name


def test_a_viewport_in_solid_shading_shows_materials_meanwhile(settings):
    """Solid shading knows one color for all points."""
    pair()
    morph()
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    shading = area.spaces[0].shading
    for before, meanwhile in (
        ("SOLID", "MATERIAL"),
        ("WIREFRAME", "MATERIAL"),
        ("MATERIAL", "MATERIAL"),
        ("RENDERED", "RENDERED"),
    ):
        shading.type = before
        for expected in (meanwhile, before, meanwhile, before):
            with bpy.context.temp_override(window=window, area=area):
                assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
            assert shading.type == expected


def test_discs_that_were_there_stay(addon, settings):
    pair()
    obj = morph()
    display, versions = addon("scene.points_display"), addon("data.versions")
    modifier = obj.modifiers[display.MODIFIER]
    versions.set_input(modifier, "Discs", True)
    for _ in range(2):
        bpy.ops.pointmorph.show_distortion()
        assert versions.input_value(modifier, "Discs")


def test_showing_makes_no_data(settings):
    pair()
    morph()
    before = data_blocks()
    bpy.ops.pointmorph.show_distortion()
    assert data_blocks() == before


def test_the_cursor_goes_to_the_worst_place(settings):
    bad_pair()
    settings.source.location = (5, 6, 7)
    obj = morph()
    [place, *_] = json.loads(obj.pointmorph.report)["worst"]
    assert '"' in place["advice"]
    row = np.flatnonzero(attribute(obj.data, "source_row") == place["source"])[0]
    for value, name in ((0.0, "Basis"), (1.0, "Morph")):
        obj.data.shape_keys.key_blocks["Morph"].value = value
        bpy.context.view_layer.update()
        assert bpy.ops.pointmorph.go_to_place() == {"FINISHED"}
        expected = key(obj, name)[row] + np.array(obj.location)
        np.testing.assert_allclose(bpy.context.scene.cursor.location, expected, atol=1e-5)


def test_confidence_is_kept_with_the_pairs_and_colors_them(addon, settings):
    bad_pair()
    obj = morph()
    display = addon("scene.points_display")
    confidence = attribute(obj.data, "confidence")
    assert ((confidence > 0) & (confidence < 1)).all()
    report = json.loads(obj.pointmorph.report)
    assert 0 < report["likely_right"] < 1

    assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
    assert bpy.ops.pointmorph.show_confidence() == {"FINISHED"}
    assert display.shows(obj, "confidence")
    assert not display.shows(obj, "distortion")
    colors = shown_colors(addon, obj)[:, :3]
    red, yellow, blue = np.array([(0.9, 0.02, 0.02), (1.0, 0.85, 0.1), (0.05, 0.25, 0.9)])
    share = 2 * confidence[:, None]
    low, high = red + share * (yellow - red), yellow + (share - 1) * (blue - yellow)
    expected = np.where(share < 1, low, high)
    np.testing.assert_allclose(colors, expected, atol=0.01)
    assert bpy.ops.pointmorph.show_confidence() == {"FINISHED"}
    assert not display.shows(obj, "confidence")


def test_a_place_in_doubt_is_gone_to_and_named(settings):
    source, _ = bad_pair()
    obj = morph()
    report = json.loads(obj.pointmorph.report)
    advice = f"Toward +X of {source.name} the map may be wrong: mark a feature there."
    place = {"source": 7, "target": 5, "confidence": 0.2, "share": 0.1, "advice": advice}
    obj.pointmorph.report = json.dumps({**report, "doubtful": [place]})
    assert bpy.ops.pointmorph.go_to_place(kind="DOUBT") == {"FINISHED"}
    there = source.matrix_world @ source.data.vertices[7].co
    np.testing.assert_allclose(bpy.context.scene.cursor.location, there, atol=1e-5)


def test_reasons_why_not(settings):
    source, _ = pair()
    for operator in ("show_distortion", "show_confidence", "go_to_place"):
        with pytest.raises(RuntimeError, match="Morph first"):
            getattr(bpy.ops.pointmorph, operator)()
    obj = morph()
    report = json.loads(obj.pointmorph.report)
    none = {"worst": [], "mesh": {"worst": []}, "doubtful": []}
    obj.pointmorph.report = json.dumps({**report, **none})
    with pytest.raises(RuntimeError, match="no bad places"):
        bpy.ops.pointmorph.go_to_place()
    obj.pointmorph.report = ""  # of an earlier version
    for name in ("distortion", "confidence"):
        obj.data.attributes.remove(obj.data.attributes[name])
    for operator in ("show_distortion", "show_confidence", "go_to_place"):
        with pytest.raises(RuntimeError):
            getattr(bpy.ops.pointmorph, operator)()
    select(source)


def test_the_panel_draws(addon, settings):
    """Everything that it asks for is there, with bad places and without a report."""
    bad_pair()
    obj = morph()
    drawn = []

    class Layout:
        def __getattr__(self, name):
            def add(*arguments, **keywords):
                drawn.append((name, arguments, keywords))
                return self

            return add

    panel = SimpleNamespace(layout=Layout())
    draw = addon("ui.quality_panel").POINTMORPH_PT_quality.draw
    context = drawing_context()
    draw(panel, context)
    texts = [keywords.get("text", "") for _, _, keywords in drawn]
    assert {"Covered", "Stretch", "Faces folded", "Round-trip error"} <= set(texts)
    assert "Folded" not in texts
    advice = json.loads(obj.pointmorph.report)["worst"][0]["advice"]
    assert advice in " ".join(texts)
    obj.pointmorph.report = ""
    drawn.clear()
    draw(panel, context)
    assert [arguments for name, arguments, _ in drawn if name == "operator"] == [
        ("pointmorph.show_distortion",),
        ("pointmorph.show_confidence",),
    ]


def report_of(obj, **figures):
    report = json.loads(obj.pointmorph.report)
    for way in report["quality"].values():
        way.update(figures)
    return report


def test_there_is_one_verdict_with_its_reasons(addon, settings):
    verdict = addon("core.quality_words").verdict
    pair(30, 26)
    report = report_of(morph())
    report["worst"], report["doubtful"], mesh = [], [], report["mesh"]
    report["likely_right"] = 0.97
    mesh |= {"grade": "good", "worst": [], "verdict": "Good: the faces of A lie smoothly on B."}
    found = verdict(report)
    assert (found.grade, found.line) == ("good", "Good: no bad places")
    assert found.reasons == ("Faces: those of A lie smoothly on B",)
    mesh["worst"] = [{}, {}]
    assert verdict(report).reasons == ("Faces: those of A lie smoothly on B, but for 2 places",)
    mesh["worst"] = []
    words = "0.3 % of the edges are creased; the vertices lie off B by 0.02 % of its size"
    mesh |= {"grade": "fair", "verdict": f"A to B: Fair: {words}."}
    found = verdict(report)
    assert (found.grade, found.line) == ("fair", "Fair: see below")
    assert found.reasons == tuple(f"Faces (A to B): {part}" for part in words.split("; "))


def test_faces_make_the_grade_and_doubts_make_it_fair_at_best(addon, settings):
    """And no reason has a grade of its own beside it."""
    words = addon("core.quality_words")
    bad_pair()
    obj = morph()
    report = report_of(obj)
    places = len(report["worst"]) + len(report["mesh"]["worst"]) + len(report["doubtful"])
    report |= {"likely_right": 0.9}
    report["mesh"] |= {"grade": "good"}
    assert words.verdict(report).line == f"Good: {places} places could be better"
    report |= {"likely_right": 0.5}
    assert words.verdict(report).line == f"Fair: {places} places to look at"
    for figures, reason in (
        ({"flipped": 0.23, "coverage": 0.91}, "Match: 9 % of the points are left out"),
        ({"flipped": 0.0, "coverage": 1.0}, "Match: only 72 % is likely right"),
    ):
        for grade in GRADES:
            report = {**report_of(obj, **figures), "likely_right": 0.72}
            said = f"{grade.capitalize()}: so it is."
            report["mesh"] |= {"grade": grade, "verdict": said, "worst": []}
            found = words.verdict(report)
            assert found.grade == max(grade, "fair", key=GRADES.index)
            assert {reason, "Faces: so it is"} <= set(found.reasons)
            assert "folded over" not in " ".join(found.reasons)
            said = " ".join(found.reasons).lower()
            assert not any(f"{other}:" in said for other in GRADES)


def test_why_a_map_from_an_earlier_one_is_thought_less_of(addon):
    """After Subdivide Source, the panel was less sure of the same map, and didn't say why."""
    words = addon("core.quality_words")
    positions, faces = patch(12)
    low, high = (pointmorph.Cloud(positions * (1, 1, z), faces=faces) for z in (1, 1.2))
    first = pointmorph.morph(low, high)
    again = pointmorph.morph(low, high, start=(first.wrapped(1.0), first.wrapped_target(0.0)))
    assert again.report["likely_right"] < first.report["likely_right"]
    said = "was computed from an earlier one"
    for made, is_from_earlier in ((first, False), (again, True)):
        of_chain = {"ways": {"A to B": made.report}}
        for report in (made.report, of_chain):
            assert (said in words.meaning("Likely right", report)) == is_from_earlier
        assert said not in words.meaning("Folded", made.report)
        reasons = words.verdict({**made.report, "likely_right": 0.7}).reasons
        of_it = next(reason for reason in reasons if "only 70 % is likely right" in reason)
        assert of_it.endswith("an earlier map") == is_from_earlier


def test_every_figure_is_explained(addon, settings):
    words = addon("core.quality_words")
    bad_pair()
    report = report_of(morph())
    for name, _ in pointmorph.quality_summary(report):
        assert len(words.FIGURES[name]) > 30, name
    explain = bpy.types.POINTMORPH_OT_explain.description
    assert explain(None, SimpleNamespace(meaning="What it is. ")) == "What it is"


@pytest.mark.parametrize(
    ("advice", "name"),
    [
        ('Between "a" and "b" the map folds over itself (1 % of Hill): …', 'Between "a" and "b"'),
        ('Near "tail" Hill is stretched 3 times (2 % of Hill): …', 'Near "tail"'),
        ('At "tip of it" faces are creased: …', 'At "tip of it"'),
        ("On the top left of Hill the map folds over itself (1 % of Hill): …", "On the top left"),
    ],
)  # fmt: skip
def test_places_have_names(addon, advice, name):
    assert addon("core.quality_words").place_name(advice) == name


def test_the_mark_that_is_missing_is_named(addon):
    missing = addon("core.quality_words").missing_marks
    names = ["ear.L", "foot_R", "foot_L", "hand left", "nose", "L", "Hill"]
    assert missing(names) == [("ear.L", "ear.R"), ("hand left", "hand right")]


def test_after_a_rename_the_report_has_the_new_name(addon, settings):
    source, target = bad_pair()
    obj = morph()
    recipes = addon("scene.recipes")
    advice = json.loads(obj.pointmorph.report)["worst"][0]["advice"]
    assert "Hill" in advice or "Dune" in advice
    source.name, target.name = "Dune", "Mountain"
    assert (source.name, target.name) == ("Dune.001", "Mountain")
    text = 'At "Hill" Hill, not Hills, is off Dune (2 % of Hill).'
    now = recipes.present_words(obj, text)
    assert now == 'At "Hill" Dune.001, not Hills, is off Mountain (2 % of Dune.001).'
    assert "Hill" not in recipes.present_words(obj, advice)
