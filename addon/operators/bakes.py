"""What the user does with a morph: bake it as shape keys or frame by frame."""

import contextlib

import bpy
import pointmorph
import pointmorph.sequences

from ..core import frame_cache, frame_plan
from ..core.settings import name_label, settings_values
from ..data import frame_formats
from ..data.frame_settings import frame_settings
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import (
    animated_shape,
    as_shown,
    cache_files,
    cached_frames,
    frame_files,
    frame_player,
    morph_object,
    morph_paths,
    own_points,
    placement,
    presentation,
    recipes,
    shape_key_bakes,
    stagger,
)
from .modal_operator import Computing
from .polls import Explained, activate, active_result, busy_reason, fail, note_done, result_reason


def path_choice(description):
    """A property that overrides the setting Path for one bake."""
    option = next(option for option in pointmorph.options() if option.name == "path")
    return bpy.props.EnumProperty(
        name="Path",
        description=description,
        items=[
            ("SETTING", "From Panel", "Use the setting Path in the panel"),
            *((name.upper(), name_label(name), option.help) for name in option.choices),
        ],
        default="SETTING",
    )


def _listed(names):
    """Names in words: all of a few, else the first, the last and how many there are."""
    if len(names) > 3:
        return f'"{names[0]}" to "{names[-1]}", {len(names)} in all'
    return ", ".join(f'"{name}"' for name in names)


class POINTMORPH_OT_bake_shape_keys(Explained, bpy.types.Operator):
    """Add the morph as shape keys. Existing keys are kept"""

    bl_idname = "pointmorph.bake_shape_keys"
    bl_label = "Bake Shape Keys"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="On",
        description="Object that gets the shape keys",
        items=[
            (
                "SOURCE",
                "Source Mesh",
                "The source itself. It keeps its faces, materials and weights, and the "
                "key makes it look like the target",
            ),
            (
                "PAIRS",
                "Morph Object",
                "The points of the morph object, which include every vertex of both shapes",
            ),
        ],
        default="SOURCE",
    )
    path: path_choice(
        "How vertices travel from step to step. A single key always moves them in straight lines"
    )
    steps: bpy.props.IntProperty(
        name="Steps",
        description="Number of shape keys, evenly spaced. The last one is the target",
        default=1,
        min=1,
        max=1000,
        soft_max=20,
    )

    @staticmethod
    def reason(context):
        return result_reason(context)

    def execute(self, context):
        obj = active_result(context)
        path = self.path.lower()
        if self.path == "SETTING":
            path = context.scene.pointmorph.path
        placement.give_back(obj)
        try:
            if self.kind == "SOURCE":
                changed, names = shape_key_bakes.bake_source(context, obj, self.steps, path)
                presentation.show_shapes(context, obj, True)
            else:
                changed = own_points.of_active(context, obj)
                names = shape_key_bakes.bake_pairs(context, changed, self.steps, path)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        note_done(self)
        said = f'Shape keys added to "{changed.name}": {_listed(names)}'
        original = recipes.original_of(changed)
        if original != changed:
            presentation.set_visible(context, original, False)
            presentation.set_visible(context, changed, True)
            said += ", a copy with modifiers applied"
            if original.type == "MESH" and not as_shown.has_cache(original):
                how = as_shown.how_to_keep(original, "it")
                said += f'. For keys on "{original.name}" itself, {how}'
        elif changed.hide_get():
            said += (
                ". It is hidden while the mesh is shown: press Points in the Result panel to see "
                "them, or bake on the source mesh for keys on its faces"
            )
        self.report({"INFO"}, said)
        return {"FINISHED"}


class POINTMORPH_OT_bake_frames(Explained, Computing, bpy.types.Operator):
    """Bake the morph frame by frame, adding points where it would show cracks"""

    bl_idname = "pointmorph.bake_frames"
    bl_label = "Bake Frames"
    bl_options = {"UNDO"}
    place = "BAKE"
    _cache = None  # the file of this bake, until an object shows it
    stopped = "Bake canceled. Finished frames are kept: bake again to continue"

    frame_start: bpy.props.IntProperty(
        name="First", description="Frame that shows the source", default=1
    )
    frame_end: bpy.props.IntProperty(
        name="Last", description="Frame that shows the target", default=48
    )
    step: bpy.props.IntProperty(
        name="Step",
        description="Number of frames from one baked frame to the next",
        default=1,
        min=1,
        max=1000,
    )
    path: path_choice("How points travel")

    @staticmethod
    def reason(context):
        return busy_reason() or result_reason(context)

    def _checked(self):
        """The plan and the format. Raises OptionError."""
        if self.frame_end <= self.frame_start:
            raise pointmorph.OptionError(
                "Last",
                f"a frame after the first, {self.frame_start}",
                str(self.frame_end),
                "Choose a later frame.",
            )
        target = frame_formats.FORMATS[self.format]
        self._by_nodes = self.faces and _makes_faces_by_nodes(target)
        faces = self.faces and not self._by_nodes
        target.check(faces)
        if faces and not pointmorph.sequences.surfaces.is_available():
            raise pointmorph.OptionError(
                "Faces",
                "the packages pymeshlab and scipy, which make faces from points",
                "a Blender without them",
                "Turn Faces off, or write meshes outside Blender with: pointmorph morph --mesh",
            )
        plan = frame_plan.Plan(
            self.frame_start, self.frame_end, self.step, self.easing, self.resample, faces
        )
        return plan, target

    def _begin_steps(self, context):
        obj = own_points.of_active(context, active_result(context))
        placement.settle(context, obj)
        self._name, self._matrix = obj.name, obj.matrix_world.copy()
        self._baked = reference_to(obj)
        plan, target = self._plan, self._target = self._checked()
        settings = settings_values(context.scene.pointmorph)
        if self.path != "SETTING":
            settings["path"] = self.path.lower()
        settings["path"] = morph_paths.meant(settings["path"], recipes.settings_of(obj))
        self._path = None
        if target.in_files:
            self._folder = frame_files.make_folder(self.directory)
        if target.suffix:
            self._path = frame_files.file_path(self._folder, self._name, target.suffix)
        self._say_at_rest(context, obj)
        held = yield from frame_player.read_steps(obj)
        timing = stagger.timing_of(context, obj)
        if timing is not None:
            frame_plan.stagger(held, settings, timing)
        taken = None
        if obj.pointmorph.follows:
            taken = yield from animated_shape.read_steps(context, obj, plan.numbers())
        if target is frame_formats.PLY:
            folder, mesh = self._folder, "ply" if plan.faces else None
            return lambda progress: pointmorph.sequences.write_sequence(
                frame_plan.sequence_of(held, plan, settings, taken),
                folder,
                mesh=mesh,
                resume=True,
                progress=progress,
            )
        place = frame_files.store_folder(self._name, self._path)
        cached = target is frame_formats.SCENE and not plan.faces
        self._rows = 0
        name = self._name
        if cached:
            frame_cache.check(name, len(obj.data.vertices))
            self._cache = cache_files.new_path(name)
        path = self._cache

        def work(progress):
            sequence = frame_plan.sequence_of(held, plan, settings, taken)
            store = pointmorph.sequences.FrameStore(place, sequence, faces=plan.faces)
            store.fill(progress)
            if cached:
                self._rows = frame_cache.write(path, name, store, progress)
            return store

        return work

    def _say_at_rest(self, context, obj):
        """The points of a morph, which are baked, know nothing of a rig that moves its mesh."""
        source, shown = recipes.shapes_of(obj)[0], morph_object.shown_of(obj)
        if source is None or obj.pointmorph.follows or not shown.pointmorph.keeps_faces:
            return
        if as_shown.is_posed(source) and as_shown.changed_by(context, source):
            self.report(
                {"WARNING"},
                f'The frames are without the pose that the armature of "{source.name}" gives to '
                f'"{shown.name}". To bake it as well, press Points and turn on Follow first',
            )

    def _leave(self, context):
        self._steps.close()  # a shape that moves may be in another frame

    def cancel(self, context):
        super().cancel(context)
        self._drop_cache()

    def _drop_cache(self):
        """Removes a file that no object shows."""
        if self._cache is not None:
            with contextlib.suppress(OSError):
                self._cache.unlink(missing_ok=True)

    def _say_written(self, place):
        self.report({"INFO"}, f"Wrote {len(self._plan.numbers())} frames to {place}")

    def _finish(self, context, outcome):
        plan = self._plan
        if self._target is frame_formats.PLY:
            self._say_written(self._folder)
            return {"FINISHED"}
        obj = find(context.scene.objects, self._baked)
        if obj is None:
            raise pointmorph.CloudError(
                self._name, "the object that is being baked", "none", "Undo the deletion."
            )
        if self._cache is not None:
            return self._finish_cache(context, obj, outcome)
        player = frame_player.build(
            context,
            self._name,
            self._matrix,
            plan,
            outcome.frames(),
            self._target.content(plan.faces),
        )
        if self._target is frame_formats.SCENE:
            player = frame_player.show(context, obj, player)
            frame_files.empty(outcome)
            self._show_alone(context, obj, player)
            self.report({"INFO"}, f'Baked {len(plan.numbers())} frames to "{player.name}"')
            return {"FINISHED"}
        try:
            frame_files.export(context, player, plan, self._path, self._target)
        finally:
            frame_player.remove(player)
        frame_files.empty(outcome)
        self.report({"WARNING"}, self._target.losses(self.faces))
        self._say_written(self._path)
        return {"FINISHED"}

    def _finish_cache(self, context, obj, store):
        try:
            player = cached_frames.show(
                context, obj, self._matrix, self._plan, (self._cache, self._rows)
            )
        except BaseException:
            self._drop_cache()
            raise
        self._cache = None
        cached_frames.show_surface(player, self._by_nodes)
        frame_files.empty(store)
        self._show_alone(context, obj, player)
        count = len(self._plan.numbers())
        size = frame_cache.size(self._rows, count) / 1e6
        self.report({"INFO"}, f'Baked {count} frames to "{player.name}", {size:,.0f} MB on disk')
        if cache_files.is_temporary(player):
            self.report(
                {"WARNING"}, "Save the file: otherwise the frames are lost when Blender quits"
            )
        return {"FINISHED"}

    def _show_alone(self, context, obj, player):
        """Shows what was baked in place of the morph, and of frames of the other kind."""
        presentation.hide(context, obj)
        for kind in (cached_frames, frame_player):
            other = kind.player_of(context.scene, obj)
            if other is not None:
                presentation.set_visible(context, other, other == player)
        activate(context.view_layer.objects, player)
        shown = morph_object.shown_of(obj)
        moves = shown.parent is not None or not placement.is_free(shown)
        if moves and player.parent is None and not len(player.constraints):
            self.report(
                {"WARNING"},
                f'"{player.name}" stays where "{shown.name}" is in this frame. To have it go '
                f'along, make "{shown.name}" its parent (Object > Parent > Object)',
            )


def _makes_faces_by_nodes(target):
    """Whether a bake gets its faces from Blender's own nodes, since nothing better is there."""
    by_nodes = target is frame_formats.SCENE and bpy.app.build_options.openvdb
    return by_nodes and not pointmorph.sequences.surfaces.is_available()


POINTMORPH_OT_bake_frames.__annotations__.update(frame_settings())


registration = Registration(
    classes=(
        POINTMORPH_OT_bake_shape_keys,
        POINTMORPH_OT_bake_frames,
    ),
)
