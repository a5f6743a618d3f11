"""What the user does: morph, bake, look at the quality."""

import json
import queue

import bpy
import numpy as np
import pointmorph

from . import display, frames, preview, previewing, result, session, transforms
from .checks import activate, active_result, busy_reason, fail, result_reason, shapes_reason
from .computation import Earlier, compute
from .jobs import Computing
from .marking import say_what_was_found
from .properties import EASINGS, FORMATS, settings_values, sync_features
from .reading import read_request


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


class POINTMORPH_OT_morph(Computing, bpy.types.Operator):
    """Compute the morph from source to target. In a window Blender stays usable; Esc stops it"""

    bl_idname = "pointmorph.morph"
    bl_label = "Morph"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        reason = busy_reason() or shapes_reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None

    stopped = "The morph was stopped"
    _value = 0.0  # of the key when the result comes

    def _begin(self, context):
        request = self._request = self._read(context)
        # A script gets the same whatever was done before it.
        earlier = session.earlier if self._in_window else None
        self._first_look, self._shown = queue.SimpleQueue(), ""
        with_preview = self._in_window and preview.is_worth_it(request)

        def work(progress):
            if with_preview:
                self._first_look.put(preview.compute(request, progress))
            return compute(request, progress, earlier)

        return work

    def _meanwhile(self, context):
        """Shows the coarse morph when it's there."""
        if self._first_look.empty():
            return
        outcome = self._first_look.get()
        if outcome is not None:
            self._shown = previewing.show(context, outcome, *self._made_of(context))

    def _leave(self, context):
        self._value = previewing.remove(self._shown)

    def _made_of(self, context):
        """What `result.build` needs besides the outcome."""
        source_name, target_name = self._names
        objects = context.scene.objects
        ends = objects.get(source_name), objects.get(target_name)
        return f"{source_name} to {target_name}", self._origin, *ends, self._source_matrix

    def _read(self, context):
        """The request. What _finish needs is kept by name: objects move in memory on undo."""
        sync_features(context.scene)
        request = read_request(context)
        say_what_was_found(context.scene, request)
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        self._source_matrix = transforms.relative_to(source.matrix_world, self._origin)
        self._names = request.source.name, request.target.name
        return request

    def _finish(self, context, outcome):
        if self._in_window:
            session.earlier = Earlier(self._request, outcome.maps)
        obj = result.build(context, outcome, *self._made_of(context))
        result.morph_key(obj).value = self._value
        activate(context.view_layer.objects, obj)
        report = outcome.report
        obj.pointmorph.report = json.dumps(report)
        for warning in report["warnings"]:
            self.report({"WARNING"}, warning)
        seconds = report["seconds"]
        self.report({"INFO"}, f'"{obj.name}": {report["pairs"]:,} pairs in {seconds:.1f} s')
        return {"FINISHED"}


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
    directory: bpy.props.StringProperty(
        name="Folder", description="Where files go", subtype="DIR_PATH", default="//frames"
    )

    @classmethod
    def poll(cls, context):
        if session.current is not None:
            cls.poll_message_set("Something is being computed: wait, or press Esc to stop it")
            return False
        reason = result_reason(context)
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
            self.frame_start, self.frame_end, self.step, self.easing, self.resample
        )
        settings = settings_values(context.scene.pointmorph)
        if self.path != "SETTING":
            settings["path"] = self.path.lower()
        if self.format in {"USD", "ALEMBIC"}:
            frames.check_format(self.format)
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
        player = frames.build(context, obj, plan, outcome)
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
        self.report({"WARNING"}, frames.LOSSES[self.format])
        self.report({"INFO"}, f"{len(outcome)} frames written to {path}")
        return {"FINISHED"}


# --- Quality -----------------------------------------------------------------------------------


def report_of(obj):
    """What a morph object remembers of `Morph.report`; None when it's of an earlier version."""
    try:
        report = json.loads(obj.pointmorph.report)
    except ValueError:
        return None
    return report if "quality" in report else None


class POINTMORPH_OT_show_distortion(bpy.types.Operator):
    """Colour the points by how bad the map is: blue good, yellow bad, red folded; or undo that"""

    bl_idname = "pointmorph.show_distortion"
    bl_label = "Show Distortion"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        obj = active_result(context)
        if obj is None:
            cls.poll_message_set("Morph first, or make a morph object the active object")
            return False
        if not display.can_show_distortion(obj):
            cls.poll_message_set("This morph was made without it, or lost its points: morph again")
            return False
        return True

    def execute(self, context):
        obj = active_result(context)
        show = not display.shows_distortion(obj)
        display.show_distortion(obj, show)
        self._shade(context, obj.pointmorph, show)
        return {"FINISHED"}

    @staticmethod
    def _shade(context, remembered, show):
        """Solid shading knows one colour for all points: material preview meanwhile."""
        space = context.space_data
        if space is None or space.type != "VIEW_3D":
            return
        if show:
            plain = space.shading.type in {"WIREFRAME", "SOLID"}
            remembered.shading_before = space.shading.type if plain else ""
            if plain:
                space.shading.type = "MATERIAL"
        elif remembered.shading_before and space.shading.type == "MATERIAL":
            space.shading.type = remembered.shading_before


class POINTMORPH_OT_go_to_place(bpy.types.Operator):
    """Put the 3D cursor where the morph is bad"""

    bl_idname = "pointmorph.go_to_place"
    bl_label = "Go to the Place"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(
        name="Place", description="0 for the worst", default=0, min=0, max=4
    )

    @classmethod
    def poll(cls, context):
        obj = active_result(context)
        if obj is None:
            cls.poll_message_set("Morph first, or make a morph object the active object")
            return False
        report = report_of(obj)
        if report is None or not report["worst"]:
            cls.poll_message_set("This morph has no bad places")
            return False
        return True

    def execute(self, context):
        obj = active_result(context)
        places = report_of(obj)["worst"]
        place = places[min(self.index, len(places) - 1)]
        context.scene.cursor.location = result.world_position(obj, place["source"])
        self.report({"INFO"}, place["advice"])
        return {"FINISHED"}


_classes = (
    POINTMORPH_OT_morph,
    POINTMORPH_OT_bake_shape_keys,
    POINTMORPH_OT_bake_frames,
    POINTMORPH_OT_show_distortion,
    POINTMORPH_OT_go_to_place,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    session.finish()
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
