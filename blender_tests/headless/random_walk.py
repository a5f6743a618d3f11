"""A user who tries anything: operations on a scene in random order, most of them with a result."""

import random
from pathlib import Path

import bpy
import pointmorph
import scenes

EXCLUDED = {
    "manual",  # opens a web page
    "add_demo",  # takes long, and begins with an empty scene of its own
}


def is_shape(obj):
    return obj.type == "MESH" and obj.name.startswith("Shape") and " to " not in obj.name


def is_own(obj):
    """Whether nothing of it belongs to another file, which alone could change it."""
    return obj.library is None and (obj.data is None or obj.data.library is None)


class BrokenError(AssertionError):
    """Something that may never happen."""


class ImpossibleError(Exception):
    """Nothing to do the step with."""


class Walk:
    """Random operations on a scene, the same for the same seed."""

    def __init__(self, addon, module, folder, seed, most_objects=12):
        self.addon, self.module, self.folder = addon, module, Path(folder)
        self.chance = random.Random(seed)
        self.most_objects = most_objects
        self.done = []
        self.counts = {}
        self.operations = [
            (3, self.add_shape), (2, self.pick), (3, self.mark), (6, self.morph),
            (3, self.slide), (2, self.go_to_frame), (6, self.operator), (3, self.set_option),
            (1, self.delete_object), (1, self.rename), (2, self.edit_shape), (2, self.undo),
            (2, self.redo), (1, self.save_and_open), (1, self.toggle_addon), (1, self.new_scene),
            (1, self.switch_scene), (2, self.select), (1, self.duplicate), (1, self.delete_data),
            (1, self.remove_group), (1, self.bake), (3, self.link), (2, self.override),
            (1, self.make_local), (1, self.reload), (2, self.share_object), (1, self.delete_scene),
            (3, self.change_while_read),
        ]  # fmt: skip

    def take(self, steps):
        """Takes that many steps. Raises BrokenError, with the last ones."""
        weights, choices = zip(*self.operations, strict=True)
        for _ in range(steps):
            [step] = self.chance.choices(choices, weights)
            self.done.append(step.__name__)
            try:
                step()
            except ImpossibleError:
                self.count("impossible")
            except Exception as error:
                # An operator that refuses says so in words, or is grayed out.
                said, refuses = str(error), isinstance(error, RuntimeError)
                if refuses and (said.startswith("Error: ") or ".poll()" in said):
                    refuses = not any(w in said for w in ("Traceback", "Python:", "console"))
                else:
                    refuses = False
                if not refuses:
                    raise BrokenError(
                        f"{self.done[-12:]}: {type(error).__name__}: {error}"
                    ) from error
                self.count("refused")
            else:
                self.count(step.__name__)
            self.look()

    def count(self, what):
        self.counts[what] = self.counts.get(what, 0) + 1

    def look(self):
        """What holds after any step: every morph can be drawn at every time, nothing runs on."""
        if not self.is_enabled:
            return
        session = self.addon("core.background_job")
        if session.current is not None or "console" in str(session.problem):
            raise BrokenError(f"{self.done[-12:]}: {session.current} {session.problem}")
        panels = [
            getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("POINTMORPH_PT_")
        ]
        for panel in panels:
            if hasattr(panel, "poll"):
                panel.poll(bpy.context)
        graph = bpy.context.evaluated_depsgraph_get()
        for obj in bpy.context.scene.objects:
            obj.evaluated_get(graph)

    @property
    def is_enabled(self):
        return hasattr(bpy.types.Scene, "pointmorph")

    # --- What is chosen at random ---

    def objects(self, of=lambda obj: True):
        return [obj for obj in bpy.context.scene.objects if of(obj)]

    def one(self, of=lambda obj: True):
        """One of the scene's objects. Raises ImpossibleError if there is none."""
        if not (found := self.objects(of)):
            raise ImpossibleError
        return self.chance.choice(found)

    def shape(self):
        return self.one(lambda obj: is_shape(obj) and is_own(obj))

    # --- Steps ---

    def add_shape(self):
        if len(self.objects()) >= self.most_objects:
            bpy.data.objects.remove(self.one())
        positions, faces = scenes.patch(self.chance.randint(4, 11), self.chance.uniform(0, 1))
        obj = scenes.add_mesh("Shape", positions, faces if self.chance.random() < 0.8 else ())
        for name, x, y in (("peak", 0, 0), ("slope", 0.5, 0.3)):
            if self.chance.random() < 0.8:
                scenes.mark(obj, name, x, y)

    def pick(self):
        shapes = self.objects(is_shape)
        if len(shapes) < 2:
            raise ImpossibleError
        scenes.pick(*self.chance.sample(shapes, 2))

    def select(self):
        for obj in self.objects():
            obj.select_set(self.chance.random() < 0.3)
        bpy.context.view_layer.objects.active = self.one()

    def mark(self):
        name = self.chance.choice(["peak", "slope", "left.L", "left.R"])
        settings = bpy.context.scene.pointmorph
        for obj in (settings.source, settings.target):
            if obj is None or not (is_shape(obj) and is_own(obj)) or not obj.data.vertices:
                raise ImpossibleError
            if (group := obj.vertex_groups.get(f"pm.{name}")) is not None:
                obj.vertex_groups.remove(group)
            if self.chance.random() < 0.95:
                vertex = self.chance.randrange(len(obj.data.vertices))
                scenes.add_group(obj, f"pm.{name}", {vertex: 1.0})

    def morph(self):
        settings = bpy.context.scene.pointmorph
        while len(self.objects(is_shape)) < 2:
            self.add_shape()
        if None in (settings.source, settings.target) or self.chance.random() < 0.3:
            self.pick()
        if self.chance.random() < 0.8:  # else it is seldom possible
            for name in ("method", "omega", "mls_degree"):
                settings.property_unset(name)
            settings.domain = "disk"  # fast for small sheets
            self._mark_both(settings.source, settings.target)
        bpy.ops.pointmorph.morph(new_result=self.chance.random() < 0.3)

    def _mark_both(self, source, target):
        names = [{group.name for group in obj.vertex_groups} for obj in (source, target)]
        for obj in filter(is_own, (source, target)):
            for name in (names[0] ^ names[1]) & set(obj.vertex_groups.keys()):
                obj.vertex_groups.remove(obj.vertex_groups[name])

    def slide(self):
        obj = self.one(lambda o: o.type == "MESH" and o.data.shape_keys is not None and is_own(o))
        for key in obj.data.shape_keys.key_blocks[1:]:
            key.value = self.chance.random()

    def go_to_frame(self):
        bpy.context.scene.frame_set(self.chance.randint(1, 60))

    def operator(self):
        """Any operator of the add-on, as a button calls it."""
        names = [name for name in dir(bpy.ops.pointmorph) if name not in EXCLUDED]
        operator = getattr(bpy.ops.pointmorph, self.chance.choice(sorted(names)))
        self.done[-1] = operator.idname_py()
        if operator.poll():
            operator(**self._arguments(operator.get_rna_type()))

    def _arguments(self, kind):
        given = {}
        for prop in kind.properties:
            if prop.identifier != "rna_type" and (prop.is_required or self.chance.random() < 0.3):
                value = self._value(prop)
                if value is not None:
                    given[prop.identifier] = value
        return given

    def _value(self, prop):
        if prop.type == "BOOLEAN" and not prop.is_array:
            return self.chance.random() < 0.5
        if prop.type == "ENUM" and prop.enum_items and not prop.is_enum_flag:
            return self.chance.choice(prop.enum_items.keys())
        if prop.type == "INT" and not prop.is_array:
            least = max(prop.hard_min, -1)
            return self.chance.randint(least, min(prop.hard_max, least + 30))
        if prop.type == "FLOAT" and not prop.is_array:
            return self.chance.uniform(max(prop.soft_min, -2.0), min(prop.soft_max, 2.0))
        if prop.type == "STRING":
            if prop.subtype in ("DIR_PATH", "FILE_PATH") or "path" in prop.identifier:
                return str(self.folder / "written")
            return self.chance.choice(["", "peak", "slope", "Shape", "no such thing"])
        return None

    def set_option(self):
        settings = bpy.context.scene.pointmorph
        names = [
            prop.identifier
            for prop in settings.bl_rna.properties
            if not prop.is_readonly and prop.type in ("BOOLEAN", "ENUM", "INT", "FLOAT")
        ]
        name = self.chance.choice(names)
        value = self._value(settings.bl_rna.properties[name])
        if value is not None:
            self.done[-1] = f"{name} = {value!r}"
            setattr(settings, name, value)

    def delete_object(self):
        bpy.data.objects.remove(self.one())

    def delete_data(self):
        obj = self.one(lambda obj: obj.data is not None)
        bpy.data.batch_remove([obj.data])

    def duplicate(self):
        obj = self.one()
        if len(self.objects()) < self.most_objects:
            copy = obj.copy()
            if obj.data is not None and self.chance.random() < 0.5:
                copy.data = obj.data.copy()
            bpy.context.scene.collection.objects.link(copy)

    def rename(self):
        obj = self.one(lambda obj: obj.library is None)
        shape = obj.name.startswith("Shape")
        obj.name = ("Shape " if shape else "") + self.chance.choice(["Ä ö", "x" * 63, "a/b", "1"])

    def edit_shape(self):
        mesh = self.shape().data
        if self.chance.random() < 0.5:
            for vertex in mesh.vertices:
                vertex.co.z *= 1.1
        else:  # another number of vertices
            side = self.chance.randint(3, 9)
            positions, faces = scenes.patch(side)
            mesh.clear_geometry()
            mesh.from_pydata(positions.tolist(), [], faces.tolist())
        mesh.update()

    def remove_group(self):
        groups = self.shape().vertex_groups
        if groups:
            groups.remove(self.chance.choice(list(groups)))

    def bake(self):
        obj = self.one(self.addon("scene.morph_object").is_result)
        scenes.select(obj)
        bpy.ops.pointmorph.bake_shape_keys()

    def undo(self):
        bpy.ops.ed.undo_push(message=f"step {len(self.done)}")
        if self.chance.random() < 0.6:
            bpy.ops.ed.undo()

    def redo(self):
        bpy.ops.ed.undo_push(message=f"step {len(self.done)}")
        bpy.ops.ed.undo()
        bpy.ops.ed.redo()

    def save_and_open(self):
        path = str(self.folder / "walk.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)

    def toggle_addon(self):
        """Disables the add-on, does something, enables it again."""
        bpy.ops.preferences.addon_disable(module=self.module)
        try:
            step = self.chance.choice([self.slide, self.go_to_frame, self.delete_object, self.undo])
            step()
        finally:
            bpy.ops.preferences.addon_enable(module=self.module)

    def new_scene(self):
        if len(bpy.data.scenes) < 3:
            bpy.context.window.scene = bpy.data.scenes.new("Another")

    def switch_scene(self):
        bpy.context.window.scene = self.chance.choice(list(bpy.data.scenes))

    def delete_scene(self):
        if len(bpy.data.scenes) < 2:
            raise ImpossibleError
        bpy.data.scenes.remove(self.chance.choice(list(bpy.data.scenes)))

    def share_object(self):
        """The same object in another scene as well."""
        obj, scene = self.one(), self.chance.choice(list(bpy.data.scenes))
        if obj.name in scene.objects:
            raise ImpossibleError
        scene.collection.objects.link(obj)

    # --- Other files ---

    # Blender's own operators for these leave a step to undo. Without, Blender itself can crash in a
    # later undo, which reads libraries that aren't there any more.

    @staticmethod
    def _note(what):
        bpy.ops.ed.undo_push(message=what)

    def link(self):
        """A shape of another file."""
        if len(self.objects()) >= self.most_objects:
            raise ImpossibleError
        number = self.chance.randrange(3)
        path = self.folder / f"library{number}.blend"
        if not path.exists():
            self._write_library(path, 5 + 2 * number)
        with bpy.data.libraries.load(str(path), link=True) as (there, wanted):
            wanted.objects = there.objects
        for obj in wanted.objects:
            if obj.name not in bpy.context.scene.objects:
                bpy.context.scene.collection.objects.link(obj)
        self._note("Link")

    def _write_library(self, path, side):
        obj = scenes.add_mesh("Shape of another file", *scenes.patch(side, 0.4))
        scenes.mark(obj, "peak", 0, 0)
        scenes.mark(obj, "slope", 0.5, 0.3)
        bpy.data.libraries.write(str(path), {obj})
        bpy.data.objects.remove(obj)

    def _linked(self):
        return self.one(lambda obj: obj.library is not None)

    def override(self):
        """What is linked can be moved, and pointed at, but has its own data elsewhere."""
        obj = self._linked().override_create(remap_local_usages=self.chance.random() < 0.5)
        if obj is None:
            raise ImpossibleError
        if obj.name not in bpy.context.scene.objects:
            bpy.context.scene.collection.objects.link(obj)
        obj.location.x += self.chance.uniform(-1, 1)
        self._note("Override")

    def make_local(self):
        obj = self.one(lambda obj: not is_own(obj))
        obj = obj.make_local()
        if obj.data is not None and self.chance.random() < 0.7:
            obj.data.make_local()
        self._note("Make local")

    def reload(self):
        """The other file has changed, or is gone for good."""
        if not bpy.data.libraries:
            raise ImpossibleError
        library = self.chance.choice(list(bpy.data.libraries))
        if self.chance.random() < 0.2:
            bpy.data.libraries.remove(library)
        else:
            self._write_library(Path(bpy.path.abspath(library.filepath)), self.chance.randint(3, 9))
            library.reload()
        self._note("Reload")

    # --- Meanwhile ---

    def change_while_read(self):
        """In a window a scene is read in turns, between which anything can happen to it."""
        settings = bpy.context.scene.pointmorph
        shapes = [shape for shape in (settings.source, settings.target) if shape is not None]
        if len(shapes) < 2:
            raise ImpossibleError
        recomputation = self.addon("scene.recomputation")
        chosen = recomputation.chosen_in(settings)
        steps = recomputation.plan_of_steps(bpy.context, shapes, chosen)
        change = self.chance.choice([
            self.delete_object, self.delete_data, self.edit_shape, self.remove_group, self.rename,
            self.reload, self.add_shape, self.slide, self.delete_scene,
        ])  # fmt: skip
        self.done[-1] += f" {change.__name__}"
        try:
            for _ in range(self.chance.randrange(20)):
                next(steps)
            change()
            self.addon("core.stepping").finish(steps)
        except StopIteration:
            change()
        except (pointmorph.PointmorphError, ReferenceError):  # said to the user by the operator
            self.count("refused while read")
        finally:
            steps.close()


def state(
    names=("scenes", "objects", "meshes", "collections", "materials", "node_groups", "actions"),
):
    """What a file holds, to compare before and after it is saved and opened again."""
    found = {}
    for kind in names:
        found[kind] = sorted(one.name_full for one in getattr(bpy.data, kind) if one.users)
    for obj in bpy.data.objects:
        if obj.type == "MESH":
            positions = scenes.coordinates(obj.data.vertices)
            keys = obj.data.shape_keys.key_blocks.keys() if obj.data.shape_keys else []
            found[obj.name_full] = positions.tobytes(), list(keys), _plain(obj.pointmorph)
    return found


def _plain(value):
    """A property's value, to compare: names in place of data-blocks."""
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.PropertyGroup):
        names = [prop.identifier for prop in value.bl_rna.properties]
        names.remove("rna_type")
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, bpy.types.bpy_prop_collection):
        return [_plain(one) for one in value]
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def check_kept(path):
    """Saves the file, opens it, and does both again. Raises BrokenError if that changes it."""
    # What only something unused uses would go at the next time alone.
    bpy.data.orphans_purge(do_recursive=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    before = state()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    after = state()
    if changed := [name for name in {**before, **after} if before.get(name) != after.get(name)]:
        raise BrokenError(f"saved and opened again, {changed} changed")
