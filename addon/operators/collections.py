"""One template to many targets: a shape key for each mesh of a collection."""

import bpy
import pointmorph

from ..core.transfer_words import listed
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import as_shown, collection_keys, morph_object
from ..scene.shape_reader import update
from .modal_operator import Computing
from .polls import Explained, busy_reason


class POINTMORPH_OT_bake_collection(Explained, Computing, bpy.types.Operator):
    """Add a shape key to the active mesh for each mesh of a collection, with the settings of the
    Pointmorph panel. Features that both meshes have are matched. Keys made earlier are updated,
    and keep their drivers and animation"""

    bl_idname = "pointmorph.bake_collection"
    bl_label = "Morph into Collection"
    bl_options = {"UNDO"}
    stopped = "Canceled: no shape keys were added"
    _is_dialog = False

    collection: bpy.props.StringProperty(
        name="Collection",
        description="Collection whose meshes become shape keys",
        options={"SKIP_SAVE"},
    )
    in_place: bpy.props.BoolProperty(
        name="In Place",
        description="Treat each mesh as if its origin were at that of the active mesh. "
        "Otherwise, its shape key also moves the active mesh to its location",
        default=True,
    )
    keys: bpy.props.BoolProperty(
        name="Their Shape Keys",
        description="Also add the shape keys of each mesh, as MESH.KEY, rotated and scaled as "
        "the surface is by the map. They depend on the slider of their mesh: at 1, "
        "they move the active mesh exactly as they move their own",
        default=False,
    )
    weights: bpy.props.BoolProperty(
        name="Their Weights",
        description="Also add the vertex groups of each mesh, as MESH.GROUP, except features",
        default=False,
    )

    @staticmethod
    def reason(context):
        template = context.view_layer.objects.active
        if template is None or template.type != "MESH" or morph_object.is_made(template):
            return "Make a mesh the active object: it gets the shape keys"
        if template.data.library is not None:
            return f'"{template.name}" is linked from another file: make it local first'
        if template.mode != "OBJECT":
            return f'Switch "{template.name}" to Object Mode first (Tab)'
        return busy_reason()

    def invoke(self, context, event):
        if self.collection or bpy.app.background:
            return super().invoke(context, event)
        self._is_dialog = True
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context):
        self.layout.prop_search(self, "collection", bpy.data, "collections")
        for name in ("in_place", "keys", "weights"):
            self.layout.prop(self, name)

    def execute(self, context):
        if not self._is_dialog or not self.collection:
            return super().execute(context)
        # In the window's background, and with an undo step of its own.
        bpy.ops.pointmorph.bake_collection(
            "INVOKE_DEFAULT",
            collection=self.collection,
            in_place=self.in_place,
            keys=self.keys,
            weights=self.weights,
        )
        return {"CANCELLED"}

    def _begin_steps(self, context):
        template = context.view_layer.objects.active
        self._template, self._name = reference_to(template), template.name
        collection = bpy.data.collections.get(self.collection)
        targets = [] if collection is None else collection_keys.targets_of(collection, template)
        if not targets:
            raise pointmorph.CloudError(
                self.collection or "collection",
                f'a collection with meshes besides "{template.name}"',
                "none" if collection is None else "no mesh in it",
                "Choose another collection.",
            )
        update(context, template, *targets)
        words = (as_shown.posed_twice(context, template, target) for target in targets)
        self._posed = next(filter(None, words), None)
        wanted = collection_keys.Wanted(self.in_place, self.keys, self.weights)
        return (yield from collection_keys.read_steps(context, template, targets, wanted))

    def _finish(self, context, outcome):
        template = find(context.scene.objects, self._template)
        if template is None:
            raise pointmorph.CloudError(
                self._name, "the mesh that gets the shape keys", "none", "Undo the deletion."
            )
        if not outcome.landed:
            raise next(iter(outcome.problems.values()))
        given = collection_keys.write(template, outcome)
        for name, error in outcome.problems.items():
            self.report({"WARNING"}, f'Left out "{name}". {error}')
        for name, error in outcome.without.items():
            self.report(
                {"WARNING"}, f'Left out the shape keys and vertex groups of "{name}". {error}'
            )
        if self._posed is not None:
            self.report({"WARNING"}, f"{self._posed}, and do this again")
        self.report({"INFO"}, f'Shape keys added to "{template.name}": {len(given.targets)}')
        if self.keys or self.weights:
            self.report({"INFO"}, _words_of_own(given))
        return {"FINISHED"}


def _words_of_own(given):
    made = {"shape key": given.keys, "vertex group": given.groups}
    made = {kind: names for kind, names in made.items() if names}
    return listed("Also added", made) if made else "No shape keys or vertex groups to add"


def _add_to_menu(self, context):
    self.layout.separator()
    self.layout.operator("pointmorph.bake_collection", icon="OUTLINER_COLLECTION")


registration = Registration(
    classes=(POINTMORPH_OT_bake_collection,),
    menus=((bpy.types.MESH_MT_shape_key_context_menu, _add_to_menu),),
)
