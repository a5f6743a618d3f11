"""What a viewport needs in order to show the colors of a morph."""

from ..scene import morph_object, presentation

_BY_MATERIAL, _BY_ATTRIBUTE = "MATERIAL", "VERTEX"


def show_colors(context, obj):
    """Lets Solid shading show the colors of discs, and gives a viewport back what it showed before
    when something else is shown. `obj` is any object of a morph."""
    points = obj.pointmorph.made_from if obj.pointmorph.keeps_faces else obj
    space = context.space_data
    if not morph_object.is_result(points) or space is None or space.type != "VIEW_3D":
        return
    shading, kept = space.shading, points.pointmorph
    discs = presentation.kind_of(points) == presentation.DISCS
    if discs and shading.color_type == _BY_MATERIAL:
        shading.color_type = _BY_ATTRIBUTE
        kept.colors_by_attribute = True
    elif not discs and kept.colors_by_attribute:
        if shading.color_type == _BY_ATTRIBUTE:
            shading.color_type = _BY_MATERIAL
        kept.colors_by_attribute = False
