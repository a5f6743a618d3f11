"""What the user does with a morph: bake it as shape keys or frame by frame."""

import bpy
import pointmorph

from . import frames, result
from .checks import activate, active_result, busy_reason, fail, result_reason
from .jobs import Computing
from .properties import EASINGS, FORMATS, settings_values


def path_choice(description):
    """A property that overrides the setting Path for one bake."""
    return bpy.props.EnumProperty(
        name="Path",
        description=description,
        items=[
            ("SETTING", "As Set", "The setting Path in the panel"),
            ("LINEAR", "Linear", "Straight"),
            ("SIMILARITY", "Similarity", "The whole turns and grows on the way"),
            ("RIGID", "Rigid", "Every part turns as well: limbs swing instead of shrinking"),
        ],
        default="SETTING",
    )


class POINTMORPH_OT_bake_shape_keys(bpy.types.Operator):
    """Add the morph as shape keys; those that are there already stay"""

    bl_idname = "pointmorph.bake_shape_keys"
    bl_label = "Bake Shape Keys"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="On",
        description="What gets the shape keys",
        items=[
            (
                "SOURCE",
                "Source Mesh",
                "The source itself: its faces, materials and weights stay, and the key makes it "
                "look like the target",
            ),
            (
                "PAIRS",
                "Morph Object",
                "The points of the morph object, which show every vertex of both",
            ),
        ],
        default="SOURCE",
    )
    path: path_choice("How vertices travel from step to step. A single key is straight in any case")
    steps: bpy.props.IntProperty(
        name="Steps",
        description="Number of shape keys, equally far from one another; the last is the target",
        default=1,
        min=1,
        max=1000,
        soft_max=20,
    )

    @classmethod
    def poll(cls, context):
        reason = result_reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
            return False
        return True

    def execute(self, context):
        obj = active_result(context)
        path = self.path.lower()
        if self.path == "SETTING":
            path = context.scene.pointmorph.path
        try:
            if self.kind == "SOURCE":
                changed = result.bake_source(obj, self.steps, path)
            else:
                result.bake_pairs(obj, self.steps, path)
                changed = obj
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        count = f"{self.steps} shape key" + ("s" if self.steps > 1 else "")
        self.report({"INFO"}, f'{count} added to "{changed.name}"')
        return {"FINISHED"}


class POINTMORPH_OT_bake_frames(Computing, bpy.types.Operator):
    """Bake the morph frame by frame, with new points where it would show cracks"""

    bl_idname = "pointmorph.bake_frames"
    bl_label = "Bake Frames"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "The bake was stopped. Frames in files stay: bake again to go on"

    format: bpy.props.EnumProperty(
        name="Format",
        description="Where the frames go",
        items=FORMATS,
        default="SCENE",
    )
    frame_start: bpy.props.IntProperty(
        name="First", description="Frame that shows the source", default=1
    )
    frame_end: bpy.props.IntProperty(
        name="Last", description="Frame that shows the target", default=48
    )
    step: bpy.props.IntProperty(
        name="Step", description="Frames from one to the next", default=1, min=1, max=1000
    )
    easing: bpy.props.EnumProperty(
        name="Easing",
        description="How the morph runs over the frames",
        items=EASINGS,
        default="LINEAR",
    )
    path: path_choice("How points travel")
    resample: bpy.props.BoolProperty(
        name="Re-sample", description="Put new points where there would be cracks", default=True
    )
    faces: bpy.props.BoolProperty(
        name="Faces",
        description="A mesh for every frame, the surface through its points, instead of points; "
        "beside the points for PLY. Needs pymeshlab and scipy in Blender's Python",
        default=False,
    )
    directory: bpy.props.StringProperty(
        name="Folder", description="Where files go", subtype="DIR_PATH", default="//frames"
    )

    @classmethod
    def poll(cls, context):
        reason = busy_reason() or result_reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
            return False
        return True

    def _begin(self, context):
        if self.frame_end <= self.frame_start:
            raise pointmorph.OptionError(
                "frame_end",
                f"a frame after the first, {self.frame_start}",
                str(self.frame_end),
                "Choose a later one.",
            )
        obj = active_result(context)
        self._name = obj.name
        plan = self._plan = frames.Plan(
            self.frame_start, self.frame_end, self.step, self.easing, self.resample, self.faces
        )
        settings = settings_values(context.scene.pointmorph)
        if self.path != "SETTING":
            settings["path"] = self.path.lower()
        if self.format in {"USD", "ALEMBIC"}:
            frames.check_format(self.format, self.faces)
        if self.faces:
            pointmorph.surfaces.check_available()
        folder = None if self.format == "SCENE" else frames.make_folder(self.directory)
        self._folder = folder
        morph = frames.read_morph(obj, settings)
        if self.format == "PLY":
            return lambda progress: frames.write_files(morph, plan, folder, progress)
        return lambda progress: frames.compute(morph, plan, progress)

    def _finish(self, context, outcome):
        plan = self._plan
        if self.format == "PLY":
            self.report({"INFO"}, f"{len(outcome)} frames written to {self._folder}")
            return {"FINISHED"}
        obj = context.scene.objects.get(self._name)
        if obj is None:
            raise pointmorph.CloudError(
                self._name, "the object that was baked", "none", "Undo its removal."
            )
        player = frames.build(context, obj, plan, outcome, self.format)
        if self.format == "SCENE":
            obj.hide_set(True)
            obj.hide_render = True
            activate(context.view_layer.objects, player)
            self.report({"INFO"}, f'{len(outcome)} frames in "{player.name}"')
            return {"FINISHED"}
        path = self._folder / f"{bpy.path.clean_name(self._name)}.{frames.SUFFIXES[self.format]}"
        try:
            frames.export(context, player, plan, path, self.format)
        finally:
            frames.remove(player)
        self.report({"WARNING"}, frames.losses(self.format, self.faces))
        self.report({"INFO"}, f"{len(outcome)} frames written to {path}")
        return {"FINISHED"}


_classes = (POINTMORPH_OT_bake_shape_keys, POINTMORPH_OT_bake_frames)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
