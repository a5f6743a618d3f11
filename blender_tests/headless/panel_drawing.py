"""What stands for a panel's layout and context where there is no window."""

from types import SimpleNamespace

import bpy


class Layout:
    """Notes the operators, and the progress, that a panel draws."""

    def __init__(self):
        self.drawn = []

    def operator(self, name, **_):
        self.drawn.append(name.removeprefix("pointmorph."))
        return SimpleNamespace()

    def progress(self, **_):
        self.drawn.append("progress")

    def __getattr__(self, name):
        return lambda *_, **__: self


def drawing_context():
    """Of a sidebar."""
    return SimpleNamespace(
        view_layer=bpy.context.view_layer,
        scene=bpy.context.scene,
        selected_objects=bpy.context.selected_objects,
        region=SimpleNamespace(width=300),
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
    )
