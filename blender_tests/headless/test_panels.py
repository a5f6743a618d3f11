"""What the sidebar draws while something is computed, and what it looks up at every redraw."""

import inspect

import bpy
import pytest
from panel_drawing import Layout, drawing_context
from scenes import morph, pair

PANELS = {
    "bake_frames": ("ui.panels", "POINTMORPH_PT_bake"),
    "blend_textures": ("ui.result_panel", "POINTMORPH_PT_more"),
    "morph": ("ui.panels", "POINTMORPH_PT_morph"),
    "propose_features": ("ui.panels", "POINTMORPH_PT_features"),
    "propose_loop": ("ui.panels", "POINTMORPH_PT_cut"),
    "recompute": ("ui.result_panel", "POINTMORPH_PT_result"),
    "show_cut": ("ui.panels", "POINTMORPH_PT_cut"),
    "subdivide_source": ("ui.result_panel", "POINTMORPH_PT_result"),
    "transfer_attributes": ("ui.result_panel", "POINTMORPH_PT_more"),
}


class Drawing:
    """Stands for the panel, which can't be made without a window."""

    def __init__(self, panel):
        self.panel, self.layout = panel, Layout()

    def __getattr__(self, name):
        return inspect.getattr_static(self.panel, name).__get__(self)


@pytest.fixture
def drawn(addon):
    """Gives what the panel with an operator's button draws, in order."""

    def draw(operator):
        module, name = PANELS[operator]
        drawing = Drawing(getattr(addon(module), name))
        drawing.draw(drawing_context())
        return drawing.layout.drawn

    return draw


@pytest.mark.parametrize("operator", PANELS)
def test_progress_stands_where_the_button_was(addon, settings, drawn, operator):
    """A button that is grayed while it computes can stay so after an error until the mouse has left
    it, though it could be pressed again."""
    job = addon("core.background_job")
    pair()
    morph().pointmorph.too_fine = "Dune"
    settings.bake_as = "FRAMES"
    assert operator in drawn(operator)
    assert "progress" not in drawn(operator)
    kind = getattr(bpy.types, f"POINTMORPH_OT_{operator}")
    job.start(kind.place)
    try:
        assert operator not in drawn(operator)
        assert "progress" in drawn(operator)
    finally:
        job.finish()
    assert operator in drawn(operator)


def test_every_operator_that_computes_is_looked_at(addon):
    """But for the collection's, which is in a menu, and the chain's, which has no button."""
    computing = addon("operators.modal_operator").Computing
    found = {c.bl_idname for c in bpy.types.Operator.__subclasses__() if issubclass(c, computing)}
    names = {name.removeprefix("pointmorph.") for name in found}
    assert names == set(PANELS) | {"bake_collection", "morph_chain"}


def test_a_redraw_parses_nothing_that_was_parsed_before(addon, settings, drawn, monkeypatch):
    """Nor does it walk through the objects of the scene: that is `active_result`'s."""
    pair()
    obj = morph()
    remembered = addon("core.remembered")
    parse, parsed = remembered.parsed_json, []
    monkeypatch.setattr(remembered, "parsed_json", lambda text: parsed.append(1) or parse(text))
    obj.pointmorph.report += " "
    obj.pointmorph.recipe += " "
    drawn("recompute")
    assert len(parsed) == 2
    drawn("recompute")
    drawn("transfer_attributes")
    assert len(parsed) == 2
