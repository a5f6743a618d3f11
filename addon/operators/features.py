"""How features come and go: marked at selected vertices, looked at, removed, proposed."""

import bmesh
import bpy
import numpy as np
import pointmorph
from mathutils import Vector

from ..core.features import PREFIX
from ..data import arrays
from ..data.feature_list import drop_choice, feature_names, forget_choice, named, sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import feature_marks, marked_points, panel_request
from ..scene.panel_request import read_request
from .modal_operator import Computing
from .polls import Explained, busy_reason, fail, shapes_reason


class POINTMORPH_OT_add_feature(Explained, bpy.types.Operator):
    """Mark the selected vertices as a feature, on source and target in Edit Mode, or on the
    active one. One vertex is a point, a path of edges a curve, anything else a region"""

    bl_idname = "pointmorph.add_feature"
    bl_label = "Add Feature"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="Name of the feature. If empty, the first feature in the list that "
        "isn't marked "
        "here yet is completed, or a new one is added",
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        reason = shapes_reason(context)
        if reason is None and not _objects_to_mark(context):
            reason = "Make the source or target the active object, and select vertices"
        return reason

    def execute(self, context):
        settings = context.scene.pointmorph
        try:
            vertices = {obj: _selected_vertices(obj) for obj in _objects_to_mark(context)}
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        sync_features(context.scene)
        name = self.name.strip().removeprefix(PREFIX) or feature_marks.next_name(
            settings, list(vertices)
        )
        for obj, rows in vertices.items():
            feature_marks.mark(obj, name, rows)
        sync_features(context.scene)
        settings.active_feature = settings.features.find(name)
        settings.features[name].confidence = -1.0
        return {"FINISHED"}


class POINTMORPH_OT_check_features(Explained, bpy.types.Operator):
    """Read what is marked on both objects, and show in the list what each feature is"""

    bl_idname = "pointmorph.check_features"
    bl_label = "Check Features"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        return shapes_reason(context)

    def execute(self, context):
        sync_features(context.scene)
        try:
            request = read_request(context)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        feature_marks.say_what_was_found(context.scene, request)
        count = len(request.features)
        self.report({"INFO"}, f"Features: {count}")
        return {"FINISHED"}


class POINTMORPH_OT_remove_feature(Explained, bpy.types.Operator):
    """Remove the selected feature from both objects"""

    bl_idname = "pointmorph.remove_feature"
    bl_label = "Remove Feature"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="Name of the feature. If empty, the one selected in the list",
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        settings = context.scene.pointmorph
        marked = feature_names(settings.source) or feature_names(settings.target)
        return None if marked else "There are no features yet"

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        names = [feature.name for feature in settings.features]
        name = self.name.strip().removeprefix(PREFIX)
        if not name:
            name = names[min(max(settings.active_feature, 0), len(names) - 1)]
        if name not in names:
            error = pointmorph.FeatureError(
                f'feature "{name}"', "a marked feature", "none of that name", "Check the name."
            )
            return fail(self, error)
        for obj in (settings.source, settings.target):
            feature_marks.unmark(obj, name)
            drop_choice(obj, name)
        sync_features(context.scene)
        forget_choice(settings, name)
        settings.active_feature = min(settings.active_feature, len(settings.features) - 1)
        return {"FINISHED"}


class POINTMORPH_OT_propose_features(Explained, Computing, bpy.types.Operator):
    """Find tips and other places that match, and mark them on both objects for you to check"""

    bl_idname = "pointmorph.propose_features"
    bl_label = "Suggest Features"
    bl_options = {"UNDO"}
    place = "FEATURES"
    stopped = "Search canceled"

    confidence: bpy.props.FloatProperty(
        name="Confidence",
        description="Pairs that are less likely to be right aren't marked",
        default=0.5,
        min=0.0,
        max=1.0,
    )
    places: bpy.props.BoolProperty(
        name="Places Between", description="Also mark places between the tips", default=False
    )

    @staticmethod
    def reason(context):
        return busy_reason() or shapes_reason(context) or feature_marks.unmarkable(context)

    def _begin(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        request = read_request(context)
        self._own = [
            panel_request.own_rows(obj, shape)
            for obj, shape in (
                (settings.source, request.source),
                (settings.target, request.target),
            )
        ]
        self._shapes = [reference_to(settings.source), reference_to(settings.target)]
        self._taken = set(request.source.marks.weights) | set(request.target.marks.weights)
        self._known = [_MarkedPlaces(shape) for shape in (request.source, request.target)]
        return lambda progress: pointmorph.propose_features(
            request.source.cloud(),
            request.target.cloud(),
            request.features,
            progress=progress,
            **request.settings,
        )

    def _finish(self, context, proposals):
        settings = context.scene.pointmorph
        objects = [find(context.scene.objects, shape) for shape in self._shapes]
        if None in objects or objects != [settings.source, settings.target]:
            self.report(
                {"WARNING"},
                "The source or target has changed in the meantime: suggest features again",
            )
            return {"CANCELLED"}
        marked, there, between, uncertain, away = [], 0, 0, 0, 0
        for proposal in proposals:
            if proposal.confidence < self.confidence:
                uncertain += 1
                continue
            if not (self.places or proposal.name.startswith("tip.")):
                between += 1
                continue
            rows = proposal.source, proposal.target
            if any(known.has(row) for known, row in zip(self._known, rows, strict=True)):
                there += 1
                continue
            own = [int(table[row]) for table, row in zip(self._own, rows, strict=True)]
            if min(own) < 0:
                away += 1
                continue
            name = proposal.name
            while name in self._taken:
                name += "_"
            for obj, row in zip(objects, own, strict=True):
                feature_marks.mark(obj, name, [row])
            marked.append((name, proposal.confidence))
        sync_features(context.scene)
        for name, confidence in marked:
            settings.features[name].confidence = confidence
        said = [f"Marked {len(marked)} of {len(proposals)} suggestions"]
        said[0] += ": check them" if marked else ""
        if there:
            said.append(f"{there} skipped where features already are")
        if between:
            said.append(f"{between} between tips: turn on Places Between to mark these")
        if away:
            said.append(f"{away} where only a modifier makes vertices")
        if uncertain:
            said.append(f"{uncertain} less likely right than {100 * self.confidence:.0f} %")
        self.report({"INFO"}, "; ".join(said))
        return {"FINISHED"}


class _MarkedPlaces:
    """Where features are marked on a shape, on one object alone or unused as well."""

    _NEAR = 0.04  # of the diagonal

    def __init__(self, shape):
        self._positions = shape.positions
        rows = [rows[weights > 0] for rows, weights in shape.marks.weights.values()]
        self._marked = shape.positions[np.concatenate(rows) if rows else []]
        self._near = self._NEAR * float(np.linalg.norm(np.ptp(shape.positions, axis=0)))

    def has(self, row):
        """Whether there is a mark near a row."""
        apart = np.linalg.norm(self._marked - self._positions[row], axis=1)
        return bool(len(apart)) and float(apart.min()) < self._near


class POINTMORPH_OT_pair_features(Explained, bpy.types.Operator):
    """Make features of marks that have the same name on both objects, apart from capitals, spaces
    and dots. Optionally, also of vertex groups without the prefix"""

    bl_idname = "pointmorph.pair_features"
    bl_label = "Pair by Name"
    bl_options = {"REGISTER", "UNDO"}

    groups: bpy.props.BoolProperty(
        name="All Vertex Groups",
        description="Also use vertex groups without the prefix, such as those of a rig. Each is "
        "copied as a feature, a region if it has several vertices",
        default=False,
    )

    @staticmethod
    def reason(context):
        return shapes_reason(context) or feature_marks.unmarkable(context)

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        count = _rename_alike(settings)
        if self.groups and "POINTCLOUD" not in (settings.source.type, settings.target.type):
            count += _copy_groups(settings.source, settings.target)
        sync_features(context.scene)
        self.report({"INFO"}, f"Pairs found: {count}")
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


class POINTMORPH_OT_jump_to_feature(Explained, bpy.types.Operator):
    """Turn the view to the selected feature, and move the 3D cursor there. If it isn't marked
    there yet, wait for a click to mark it"""

    bl_idname = "pointmorph.jump_to_feature"
    bl_label = "Jump to Feature"
    bl_options = {"REGISTER", "UNDO"}

    side: bpy.props.EnumProperty(
        name="On",
        description="Object to view the feature on",
        items=[
            ("SOURCE", "Source", "View it on the source"),
            ("TARGET", "Target", "View it on the target"),
        ],
        default="SOURCE",
    )

    @staticmethod
    def reason(context):
        settings = context.scene.pointmorph
        reason = shapes_reason(context)
        if reason is None and not 0 <= settings.active_feature < len(settings.features):
            reason = "Select a feature in the list"
        return reason

    def invoke(self, context, event):
        obj, name = self._meant(context)
        if name in feature_names(obj) or not bpy.ops.pointmorph.click_features.poll():
            return self.execute(context)
        bpy.ops.pointmorph.click_features("INVOKE_DEFAULT", name=name)
        if context.region_data is not None:
            corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
            context.region_data.view_location = sum(corners, Vector()) / 8
        return {"CANCELLED"}  # the click is the step that can be undone

    def _meant(self, context):
        settings = context.scene.pointmorph
        obj = settings.source if self.side == "SOURCE" else settings.target
        return obj, settings.features[settings.active_feature].marked_name

    def execute(self, context):
        obj, name = self._meant(context)
        found = marked_points.marks_of(obj, wait=True).get(name)
        if found is None:
            error = pointmorph.FeatureError(
                obj.name, f'a point marked as "{name}"', "none", "Mark it there first."
            )
            return fail(self, error)
        depsgraph = context.evaluated_depsgraph_get()
        place = marked_points.place_of(obj, found.row, depsgraph)
        context.scene.cursor.location = place
        if context.region_data is not None:
            look_at(context.region_data, place, marked_points.normal_of(obj, found.row, depsgraph))
        return {"FINISHED"}


def look_at(view, place, normal):
    """Turns a view so that a place is in its middle and shows its outside."""
    if view.view_perspective == "CAMERA":
        view.view_perspective = "PERSP"
    view.view_location = place
    if normal is not None and normal.length > 0:
        view.view_rotation = normal.to_track_quat("Z", "Y")


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
            f"an object of type {arrays.type_name(obj)}",
            f'Store a point attribute "{PREFIX}name" that is 1 at the point, for instance with '
            "Geometry Nodes.",
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


registration = Registration(
    classes=(
        POINTMORPH_OT_add_feature,
        POINTMORPH_OT_check_features,
        POINTMORPH_OT_remove_feature,
        POINTMORPH_OT_propose_features,
        POINTMORPH_OT_pair_features,
        POINTMORPH_OT_jump_to_feature,
    ),
)
