"""What the user does: morph, bake, mark features."""

import json

import bmesh
import bpy
import numpy as np
import pointmorph

from . import arrays, display, frames, remaking, result, session, transforms
from .computation import Earlier, compute
from .features import PREFIX, description
from .properties import feature_choices, feature_names, settings_values, sync_features
from .reading import read_request


def fail(operator, error):
    """Tells the user about a PointmorphError. In scripts the operator raises RuntimeError then."""
    operator.report({"ERROR"}, str(error))
    return {"CANCELLED"}


def shapes_reason(context):
    """Why source and target can't be used as they were picked; None when they can."""
    settings = context.scene.pointmorph
    for side, obj in (("source", settings.source), ("target", settings.target)):
        if obj is None:
            return f"Pick a {side} first"
        if context.scene.objects.get(obj.name) != obj:
            return f'The {side} "{obj.name}" is no longer in the scene: pick another'
    if settings.source == settings.target:
        return f'Source and target are both "{settings.source.name}": pick two objects'
    return None


def active_result(context):
    """The morph object that is meant: the active one, else the last one of source and target."""
    active = context.view_layer.objects.active
    if result.is_result(active):
        return active
    settings = context.scene.pointmorph
    found = None
    if settings.source is not None:
        for obj in context.scene.objects:
            made_from = (obj.pointmorph.source, obj.pointmorph.target)
            if made_from == (settings.source, settings.target) and result.is_result(obj):
                found = obj
    return found


def result_reason(context):
    """Why there is no morph object that could be baked; None when there is one."""
    obj = active_result(context)
    if obj is None:
        return "Morph first, or make a morph object the active object"
    return "Leave Edit Mode first" if obj.mode == "EDIT" else None


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


class _Computing:
    """What an operator needs that computes in a thread while Blender stays usable.

    It has `_begin(context)`, which reads the scene and returns what to call with a progress, and
    `_finish(context, outcome)`, which changes the scene.
    """

    _in_window = False

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        try:
            self._in_window = True
            compute = self._begin(context)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        session.start(compute)
        window_manager = context.window_manager
        self._timer = window_manager.event_timer_add(0.05, window=context.window)
        window_manager.modal_handler_add(self)
        self._show_progress(context)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            session.current.cancel()
            self._show_progress(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not session.current.done:
            self._show_progress(context)
            return {"PASS_THROUGH"}
        job = self._end(context)
        try:
            outcome = job.result()
            return self._finish(context, outcome)
        except pointmorph.Cancelled:
            self.report({"INFO"}, self.stopped)
            return {"CANCELLED"}
        except pointmorph.PointmorphError as error:
            return fail(self, error)

    def cancel(self, context):
        """Called by Blender when the window or the file is closed."""
        self._end(context)

    def execute(self, context):
        try:
            # A function of Python's, so that Ctrl-C works.
            return self._finish(context, self._begin(context)(lambda stage, fraction: True))
        except pointmorph.PointmorphError as error:
            return fail(self, error)

    def _show_progress(self, context):
        context.workspace.status_text_set(progress_text() + "   Esc: stop")
        _redraw_sidebars(context)

    def _end(self, context):
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        job = session.finish()
        _redraw_sidebars(context)
        return job


class POINTMORPH_OT_morph(_Computing, bpy.types.Operator):
    """Compute the morph from source to target. In a window Blender stays usable; Esc stops it"""

    bl_idname = "pointmorph.morph"
    bl_label = "Morph"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if session.current is not None:
            cls.poll_message_set("A morph is being computed: wait, or press Esc to stop it")
            return False
        reason = shapes_reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
            return False
        return True

    stopped = "The morph was stopped"

    def _begin(self, context):
        request = self._request = self._read(context)
        # A script gets the same whatever was done before it.
        earlier = session.earlier if self._in_window else None
        return lambda progress: compute(request, progress, earlier)

    def _read(self, context):
        """The request. What _finish needs is kept by name: objects move in memory on undo."""
        sync_features(context.scene)
        request = read_request(context)
        say_what_was_found(context.scene, request)
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        self._source_matrix = transforms.relative_to(source.matrix_world, self._origin)
        self._names = request.source.name, request.target.name
        self._recipe = remaking.take_down(
            [source, context.scene.pointmorph.target],
            [request],
            self._origin,
            feature_choices(context.scene.pointmorph),
        )
        return request

    def _finish(self, context, outcome):
        if self._in_window:
            session.earlier = Earlier(self._request, outcome.maps)
        source_name, target_name = self._names
        objects = context.scene.objects
        obj = result.build(
            context,
            outcome,
            f"{source_name} to {target_name}",
            self._origin,
            objects.get(source_name),
            objects.get(target_name),
            self._source_matrix,
        )
        _activate(context.view_layer.objects, obj)
        report = outcome.report
        remaking.remember(obj, self._recipe, outcome)
        for warning in report["warnings"]:
            self.report({"WARNING"}, warning)
        seconds = report["seconds"]
        self.report({"INFO"}, f'"{obj.name}": {report["pairs"]:,} pairs in {seconds:.1f} s')
        return {"FINISHED"}


def _activate(objects, obj):
    """Selects `obj` alone, unless it's in an excluded collection or the user is in another mode."""
    in_object_mode = objects.active is None or objects.active.mode == "OBJECT"
    if in_object_mode and objects.get(obj.name) == obj:
        for other in list(objects.selected):
            other.select_set(False)
        obj.select_set(True)
        objects.active = obj


def progress_text():
    """What the running job is at."""
    job = session.current
    if job.cancelled:
        return "Stopping"
    return f"{job.stage.replace('_', ' ').capitalize() or 'Starting'} {100 * job.fraction:.0f} %"


def _redraw_sidebars(context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


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


class POINTMORPH_OT_bake_frames(_Computing, bpy.types.Operator):
    """Bake the morph frame by frame, with new points where it would show cracks"""

    bl_idname = "pointmorph.bake_frames"
    bl_label = "Bake Frames"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "The bake was stopped. Frames in files stay: bake again to go on"

    format: bpy.props.EnumProperty(
        name="Format",
        description="Where the frames go",
        items=[
            ("SCENE", "In the Scene", "An object that shows the frame of the scene as points"),
            ("PLY", "PLY Files", "One file a frame with all there is, id and velocity too"),
            ("USD", "USD", "One file: positions, radius, colour. From Blender 4.5 on"),
            ("ALEMBIC", "Alembic", "One file: positions only, as vertices"),
        ],
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
        items=[
            ("LINEAR", "Even", "At the same speed all the time"),
            ("SMOOTH", "Smooth", "Begins and ends slowly"),
        ],
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
            _activate(context.view_layer.objects, player)
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


# --- Features -------------------------------------------------------------------------------------


class POINTMORPH_OT_add_feature(bpy.types.Operator):
    """Mark the selected vertices as a feature: on each picked object in Edit Mode, or the active.
    One is a point, a path of edges a curve, any other several are a region"""

    bl_idname = "pointmorph.add_feature"
    bl_label = "Add Feature"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="The feature's name. Without one, the first feature of the list that isn't "
        "marked here yet is completed, or a new one begun",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context):
        reason = shapes_reason(context)
        if reason is None and not _objects_to_mark(context):
            reason = "Make the source or the target the active object, and select vertices"
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None

    def execute(self, context):
        settings = context.scene.pointmorph
        try:
            vertices = {obj: _selected_vertices(obj) for obj in _objects_to_mark(context)}
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        sync_features(context.scene)
        name = self.name.strip().removeprefix(PREFIX) or _next_name(settings, list(vertices))
        for obj, rows in vertices.items():
            _mark(obj, name, rows)
        sync_features(context.scene)
        settings.active_feature = settings.features.find(name)
        settings.features[name].confidence = -1.0
        return {"FINISHED"}


class POINTMORPH_OT_check_features(bpy.types.Operator):
    """Look at what is marked on both objects, and say in the list what each feature is"""

    bl_idname = "pointmorph.check_features"
    bl_label = "Check Features"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        reason = shapes_reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None

    def execute(self, context):
        sync_features(context.scene)
        try:
            request = read_request(context)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        say_what_was_found(context.scene, request)
        count = len(request.features)
        self.report({"INFO"}, f"{count} feature" + ("" if count == 1 else "s"))
        return {"FINISHED"}


def say_what_was_found(scene, request):
    """Writes into the list of features what each of them is."""
    for item in scene.pointmorph.features:
        if item.marked_name in request.features:
            found = description(request.features[item.marked_name])
            if item.found != found:
                item.found = found


class POINTMORPH_OT_remove_feature(bpy.types.Operator):
    """Remove the feature chosen in the list, on both objects"""

    bl_idname = "pointmorph.remove_feature"
    bl_label = "Remove Feature"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="The feature's name; without one, that which is chosen in the list",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context):
        settings = context.scene.pointmorph
        if feature_names(settings.source) or feature_names(settings.target):
            return True
        cls.poll_message_set("There is no feature yet")
        return False

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        names = [feature.name for feature in settings.features]
        name = self.name.strip().removeprefix(PREFIX)
        if not name:
            name = names[min(max(settings.active_feature, 0), len(names) - 1)]
        if name not in names:
            error = pointmorph.FeatureError(
                f'feature "{name}"', "one that is marked", "none of that name", "Check the name."
            )
            return fail(self, error)
        for obj in (settings.source, settings.target):
            if name in feature_names(obj):
                named = obj.vertex_groups if obj.type == "MESH" else obj.data.attributes
                named.remove(named[PREFIX + name])
        sync_features(context.scene)
        settings.active_feature = min(settings.active_feature, len(settings.features) - 1)
        return {"FINISHED"}


class POINTMORPH_OT_propose_features(bpy.types.Operator):
    """Find tips and other places that belong together and mark them on both objects, to check"""

    bl_idname = "pointmorph.propose_features"
    bl_label = "Propose"
    bl_options = {"REGISTER", "UNDO"}

    confidence: bpy.props.FloatProperty(
        name="Confidence",
        description="Less likely pairs aren't marked",
        default=0.5,
        min=0.0,
        max=1.0,
    )
    places: bpy.props.BoolProperty(
        name="Places Between", description="Mark places between the tips too", default=False
    )

    @classmethod
    def poll(cls, context):
        reason = shapes_reason(context)
        if reason is None:
            settings = context.scene.pointmorph
            for obj in (settings.source, settings.target):
                if obj.type != "MESH":
                    reason = f'"{obj.name}" is no mesh, which has vertex groups'
                elif obj.mode == "EDIT":
                    reason = "Leave Edit Mode first"
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None

    def execute(self, context):
        settings = context.scene.pointmorph
        objects = (settings.source, settings.target)
        try:
            request = read_request(context)
            if len(request.target.positions) != len(settings.target.data.vertices):
                raise pointmorph.FeatureError(
                    settings.target.name,
                    f"the {len(settings.target.data.vertices)} vertices of the mesh",
                    f"{len(request.target.positions)} with modifiers",
                    "Apply the modifiers that add or remove vertices, or disable them.",
                )
            proposals = pointmorph.propose_features(
                request.source.cloud(),
                request.target.cloud(),
                request.features,
                progress=lambda stage, fraction: True,
                **request.settings,
            )
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        marked = []
        for proposal in proposals:
            wanted = self.places or proposal.name.startswith("tip.")
            if not wanted or proposal.confidence < self.confidence:
                continue
            name = proposal.name
            while name in request.features:
                name += "_"
            for obj, row in zip(objects, (proposal.source, proposal.target), strict=True):
                _mark(obj, name, [row])
            marked.append((name, proposal.confidence))
        sync_features(context.scene)
        for name, confidence in marked:
            settings.features[name].confidence = confidence
        found = f"{len(marked)} of {len(proposals)} proposals marked"
        self.report({"INFO"}, found + (": check them" if marked else "; the rest is too unsure"))
        return {"FINISHED"}


def _objects_to_mark(context):
    """The picked objects that are being edited, or the active object when it's one of them."""
    settings = context.scene.pointmorph
    picked = [settings.source, settings.target]
    edited = [obj for obj in picked if obj.mode == "EDIT"]
    return edited or [obj for obj in picked if obj == context.view_layer.objects.active]


def _selected_vertices(obj):
    """Rows of the vertices that are selected."""
    if obj.type != "MESH":
        raise pointmorph.FeatureError(
            obj.name,
            "a mesh",
            f"an object of type {obj.type}",
            f'Store a point attribute "{PREFIX}name" that is 1 at the point, for instance with '
            "geometry nodes.",
        )
    if obj.mode == "EDIT":
        vertices = bmesh.from_edit_mesh(obj.data).verts
        selected = [vertex.index for vertex in vertices if vertex.select]
    else:
        selected = arrays.selected_vertices(obj.data)
    if not len(selected):
        raise pointmorph.FeatureError(
            obj.name,
            "selected vertices",
            "none",
            "Select one vertex in Edit Mode, or several for a curve or a region.",
        )
    return [int(row) for row in selected]


def _next_name(settings, objects):
    for feature in settings.features:
        if not any(feature.name in feature_names(obj) for obj in objects):
            return feature.name
    taken = {feature.name for feature in settings.features}
    number = 1
    while f"feature {number}" in taken:
        number += 1
    return f"feature {number}"


def _mark(obj, name, rows):
    """Makes the vertex group of a feature hold these vertices and no others."""
    old = obj.vertex_groups.get(PREFIX + name)
    if old is not None:
        obj.vertex_groups.remove(old)
    group = obj.vertex_groups.new(name=PREFIX + name)
    if obj.mode == "EDIT":
        mesh = bmesh.from_edit_mesh(obj.data)
        layer = mesh.verts.layers.deform.verify()
        mesh.verts.ensure_lookup_table()
        for row in rows:
            mesh.verts[row][layer][group.index] = 1.0
        bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)
    else:
        group.add(rows, 1.0, "REPLACE")


_classes = (
    POINTMORPH_OT_morph,
    POINTMORPH_OT_bake_shape_keys,
    POINTMORPH_OT_bake_frames,
    POINTMORPH_OT_show_distortion,
    POINTMORPH_OT_go_to_place,
    POINTMORPH_OT_add_feature,
    POINTMORPH_OT_check_features,
    POINTMORPH_OT_remove_feature,
    POINTMORPH_OT_propose_features,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    session.finish()
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
