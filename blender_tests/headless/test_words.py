"""What the add-on says about itself."""

import bpy
import pointmorph
import pytest
from spelling import british

KINDS = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup)


def own_classes(module):
    return [
        (base, cls)
        for base in KINDS
        for cls in base.__subclasses__()
        if cls.__module__.startswith(f"{module}.")
    ]


def texts_of(base, cls):
    """What Blender shows of a class: (where, text) of names, tooltips, and those of properties."""
    known = cls.bl_rna
    if base is not bpy.types.PropertyGroup:
        yield cls.__name__, cls.bl_label
    if base is bpy.types.Operator:
        known = getattr(bpy.ops.pointmorph, cls.bl_idname.split(".")[1]).get_rna_type()
        yield cls.__name__, known.description
    inherited = {"rna_type", *base.bl_rna.properties.keys()} - {"name"}
    for item in known.properties:
        # A list's items have a name by themselves.
        if item.identifier in inherited or (item.identifier == "name" and not item.description):
            continue
        where = f"{cls.__name__}.{item.identifier}"
        yield where, item.name
        yield where, item.description
        of_library = item.identifier in {option.name for option in pointmorph.options()}
        for choice in item.enum_items if item.type == "ENUM" and not of_library else ():
            yield f"{where}.{choice.identifier}", choice.name
            yield f"{where}.{choice.identifier}", choice.description


@pytest.fixture(scope="module")
def texts(module):
    classes = own_classes(module)
    assert len(classes) > 40
    found = [pair for base, cls in classes for pair in texts_of(base, cls)]
    assert len(set(found)) > 250
    return found


def test_everything_has_a_name_and_a_tooltip(texts):
    assert [where for where, text in texts if not text.strip()] == []


def test_tooltips_are_written_as_blenders_are(texts):
    """On one line, without a full stop at the end, in American spelling."""
    for where, text in texts:
        assert "\n" not in text, where
        assert "  " not in text, where
        assert not text.endswith("."), (where, text)
        assert british(text) == [], (where, text)
