"""How features come and go: marked at selected vertices, looked at, removed, proposed."""

import bmesh
import bpy
import pointmorph

from . import arrays, markers
from .checks import busy_reason, fail, possible, shapes_reason
from .features import PREFIX, description
from .jobs import Computing
from .properties import feature_names, named, sync_features
from .reading import read_request
from .translations import tell


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
        return possible(cls, reason)

    def execute(self, context):
        settings = context.scene.pointmorph
        try:
            vertices = {obj: _selected_vertices(obj) for obj in _objects_to_mark(context)}
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        sync_features(context.scene)
        name = self.name.strip().removeprefix(PREFIX) or next_name(settings, list(vertices))
        for obj, rows in vertices.items():
            mark(obj, name, rows)
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
        return possible(cls, shapes_reason(context))

    def execute(self, context):
        sync_features(context.scene)
        try:
            request = read_request(context)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        say_what_was_found(context.scene, request)
        count = len(request.features)
        self.report({"INFO"}, tell("Features: {count}", count=count))
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
            unmark(obj, name)
        sync_features(context.scene)
        settings.active_feature = min(settings.active_feature, len(settings.features) - 1)
        return {"FINISHED"}


class POINTMORPH_OT_propose_features(Computing, bpy.types.Operator):
    """Find tips and other places that belong together and mark them on both objects, to check"""

    bl_idname = "pointmorph.propose_features"
    bl_label = "Propose"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "The search was stopped"

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
        return possible(cls, busy_reason() or shapes_reason(context) or unmarkable(context))

    def _begin(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        request = read_request(context)
        own, shown = markers.size_of(settings.target), len(request.target.positions)
        if own != shown:
            raise pointmorph.FeatureError(
                settings.target.name,
                f"the {own} vertices of the mesh",
                f"{shown} with modifiers",
                "Apply the modifiers that add or remove vertices, or disable them.",
            )
        self._names = request.source.name, request.target.name
        self._taken = set(request.source.marks.weights) | set(request.target.marks.weights)
        return lambda progress: pointmorph.propose_features(
            request.source.cloud(),
            request.target.cloud(),
            request.features,
            progress=progress,
            **request.settings,
        )

    def _finish(self, context, proposals):
        settings = context.scene.pointmorph
        objects = [context.scene.objects.get(name) for name in self._names]
        if None in objects or objects != [settings.source, settings.target]:
            self.report({"WARNING"}, "Source or target were exchanged meanwhile: propose again")
            return {"CANCELLED"}
        marked = []
        for proposal in proposals:
            wanted = self.places or proposal.name.startswith("tip.")
            if not wanted or proposal.confidence < self.confidence:
                continue
            name = proposal.name
            while name in self._taken:
                name += "_"
            for obj, row in zip(objects, (proposal.source, proposal.target), strict=True):
                mark(obj, name, [row])
            marked.append((name, proposal.confidence))
        sync_features(context.scene)
        for name, confidence in marked:
            settings.features[name].confidence = confidence
        found = (
            "{count} of {all} proposals marked: check them"
            if marked
            else "{count} of {all} proposals marked; the rest is too unsure"
        )
        self.report({"INFO"}, tell(found, count=len(marked), all=len(proposals)))
        return {"FINISHED"}


class POINTMORPH_OT_pair_features(bpy.types.Operator):
    """Make features of what has the same name on both objects: marks whose names differ in
    capitals, spaces and dots alone and, where asked for, vertex groups without the prefix"""

    bl_idname = "pointmorph.pair_features"
    bl_label = "Pair by Name"
    bl_options = {"REGISTER", "UNDO"}

    groups: bpy.props.BoolProperty(
        name="All Vertex Groups",
        description="Take vertex groups without the prefix too, such as those of a rig: each is "
        "copied as a feature, a region where it holds several vertices",
        default=False,
    )

    @classmethod
    def poll(cls, context):
        return possible(cls, shapes_reason(context) or unmarkable(context))

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        count = _rename_alike(settings)
        if self.groups and "POINTCLOUD" not in (settings.source.type, settings.target.type):
            count += _copy_groups(settings.source, settings.target)
        sync_features(context.scene)
        self.report({"INFO"}, tell("Pairs found: {count}", count=count))
        return {"FINISHED"}


def _plain(name):
    return "".join(letter for letter in name.casefold() if letter.isalnum())


def _rename_alike(settings):
    """Gives marks of the target the names of those of the source that differ in spelling alone."""
    left = {_plain(f.name): f.name for f in settings.features if f.on_source and not f.on_target}
    others = [f.name for f in settings.features if f.on_target and not f.on_source]
    marks = named(settings.target)
    count = 0
    for name in others:
        wanted = left.pop(_plain(name), None)
        if wanted is not None:
            marks[PREFIX + name].name = PREFIX + wanted
            count += 1
    return count


def _copy_groups(source, target):
    """Makes features of the vertex groups that hold something on both objects."""
    marked = {*feature_names(source), *feature_names(target)}
    names = [
        group.name
        for group in source.vertex_groups
        if group.name in target.vertex_groups
        and not group.name.startswith(PREFIX)
        and group.name not in marked
    ]
    members = {}
    for obj in (source, target):
        groups = {obj.vertex_groups[name].index: name for name in names}
        members[obj] = arrays.vertex_groups(obj.data, groups)
    full = [name for name in names if all((of[name][1] > 0).any() for of in members.values())]
    for name in full:
        for obj, of in members.items():
            group = obj.vertex_groups.new(name=PREFIX + name)
            for row, weight in zip(*of[name], strict=True):
                if weight > 0:
                    group.add([int(row)], float(weight), "REPLACE")
    return len(full)


class POINTMORPH_OT_jump_to_feature(bpy.types.Operator):
    """Look at the feature chosen in the list: the view and the 3D cursor go there"""

    bl_idname = "pointmorph.jump_to_feature"
    bl_label = "Jump to Feature"
    bl_options = {"REGISTER", "UNDO"}

    side: bpy.props.EnumProperty(
        name="On",
        description="The object on which to look at it",
        items=[
            ("SOURCE", "Source", "Where it is on the source"),
            ("TARGET", "Target", "Where it is on the target"),
        ],
        default="SOURCE",
    )

    @classmethod
    def poll(cls, context):
        settings = context.scene.pointmorph
        reason = shapes_reason(context)
        if reason is None and not 0 <= settings.active_feature < len(settings.features):
            reason = "Choose a feature in the list"
        return possible(cls, reason)

    def execute(self, context):
        settings = context.scene.pointmorph
        obj = settings.source if self.side == "SOURCE" else settings.target
        name = settings.features[settings.active_feature].marked_name
        found = markers.marks_of(obj, wait=True).get(name)
        if found is None:
            error = pointmorph.FeatureError(
                obj.name, f'a point marked as "{name}"', "none", "Mark it there first."
            )
            return fail(self, error)
        place = markers.place_of(obj, found.row, context.evaluated_depsgraph_get())
        context.scene.cursor.location = place
        if context.region_data is not None:
            context.region_data.view_location = place
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


def next_name(settings, objects):
    for feature in settings.features:
        if not any(feature.name in feature_names(obj) for obj in objects):
            return feature.name
    taken = {feature.name for feature in settings.features}
    number = 1
    while f"feature {number}" in taken:
        number += 1
    return f"feature {number}"


def mark(obj, name, rows):
    """Makes the feature's vertex group (of a point cloud: attribute) hold these points only."""
    unmark(obj, name)
    if obj.type == "POINTCLOUD":
        arrays.mark_points(obj.data, PREFIX + name, rows)
    else:
        _fill_group(obj, obj.vertex_groups.new(name=PREFIX + name), rows)
    if len(rows) == 1:
        markers.note(obj, name, rows[0])


def _fill_group(obj, group, rows):
    if obj.mode == "EDIT":
        mesh = bmesh.from_edit_mesh(obj.data)
        layer = mesh.verts.layers.deform.verify()
        mesh.verts.ensure_lookup_table()
        for row in rows:
            mesh.verts[row][layer][group.index] = 1.0
        bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)
    else:
        group.add(rows, 1.0, "REPLACE")


def unmark(obj, name):
    """Takes a feature off an object."""
    if name in feature_names(obj):
        marks = named(obj)
        marks.remove(marks[PREFIX + name])


def unmarkable(context):
    """Why features can't be marked in Object Mode; None when they can."""
    settings = context.scene.pointmorph
    for obj in (settings.source, settings.target):
        if obj.mode == "EDIT":
            return "Leave Edit Mode first"
        if obj.library is not None or obj.data.library is not None:
            linked = '"{name}" is linked from another file: make it local to mark it'
            return tell(linked, name=obj.name)
        if obj.type == "POINTCLOUD" and not len(obj.data.points):
            made = 'The points of "{name}" are made by nodes: make them real to mark them'
            return tell(made, name=obj.name)
    return None


_classes = (
    POINTMORPH_OT_add_feature,
    POINTMORPH_OT_check_features,
    POINTMORPH_OT_remove_feature,
    POINTMORPH_OT_propose_features,
    POINTMORPH_OT_pair_features,
    POINTMORPH_OT_jump_to_feature,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
