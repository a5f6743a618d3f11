"""What differs between Blender 4.2 and later versions: the only module that asks."""

import bpy


def is_at_least(*version):
    """Whether this Blender is of that version, (major, minor), or a later one."""
    return bpy.app.version[:2] >= version


def name():
    """ "Blender 4.2" or the like."""
    return "Blender " + ".".join(map(str, bpy.app.version[:2]))


RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if is_at_least(4, 5) else set()
"""Options of a path that may begin with //, of which Blender warns otherwise since 5.0."""


def set_voxel_size(node):
    """Makes a node that makes a volume take the size of its voxels. A property until Blender 5."""
    if hasattr(node, "resolution_mode"):
        node.resolution_mode = "VOXEL_SIZE"
    else:
        node.inputs["Resolution Mode"].default_value = "Size"


# --- Inputs of a modifier's group of nodes --------------------------------------------------------
# Blender 5.2 took them out of the modifier's own items.


def group_inputs(group):
    """By name, the inputs of a group of nodes."""
    items = group.interface.items_tree
    return {i.name: i for i in items if i.item_type == "SOCKET" and i.in_out == "INPUT"}


def plain_inputs(group):
    """By name, those that are no geometry and so have a value."""
    known = group_inputs(group).items()
    return {n: i for n, i in known if i.socket_type != "NodeSocketGeometry"}


def input_value(modifier, name):
    """The value of an input of a modifier's group; None where it was never set."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier).value
    return modifier.get(identifier)


def set_input(modifier, name, value):
    """Gives an input of a modifier's group a value."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        modifier[identifier] = value


def input_attribute(modifier, name):
    """The name of the attribute that an input of a modifier's group takes, or None where it has a
    value."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        found = getattr(modifier.properties.inputs, identifier)
        return found.attribute_name if getattr(found, "type", "VALUE") == "ATTRIBUTE" else None
    return (
        modifier.get(f"{identifier}_attribute_name")
        if modifier.get(f"{identifier}_use_attribute")
        else None
    )


def set_input_attribute(modifier, name, attribute):
    """Makes an input of a modifier's group take an attribute."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        found = getattr(modifier.properties.inputs, identifier)
        found.type, found.attribute_name = "ATTRIBUTE", attribute
    else:
        modifier[f"{identifier}_use_attribute"] = True
        modifier[f"{identifier}_attribute_name"] = attribute


def choice_of(modifier, name, choices):
    """The word that an input with a menu has: one of `choices`, all of them in order."""
    value = input_value(modifier, name)
    return choices[value or 0] if not isinstance(value, str) else value


def set_choice(modifier, name, choices, word):
    """Gives an input with a menu one of its `choices`."""
    by_word = hasattr(modifier, "properties")
    set_input(modifier, name, word if by_word else choices.index(word))


def input_property(modifier, name):
    """What has the value of an input, and the name of that property, as layouts take them."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def input_path(modifier, name):
    """The data path from the object to an input of a modifier's group, for drivers."""
    identifier = group_inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):
        return f'modifiers["{modifier.name}"].properties.inputs.{identifier}.value'
    return f'modifiers["{modifier.name}"]["{identifier}"]'


# --- Animation ------------------------------------------------------------------------------------


def curve_of(block, path):
    """The animation curve of a data-block's property, or None."""
    found = (curves.find(path) for curves in _lists_of_curves(block))
    return next((curve for curve in found if curve is not None), None)


def curves_of(block):
    """All animation curves of a data-block."""
    return [curve for curves in _lists_of_curves(block) for curve in curves]


def turns_mirrored_faces():
    """Whether Blender turns faces where it applies a mirroring to a mesh."""
    return is_at_least(5, 1)


def remove_curve(block, path):
    """Takes the animation curve of a data-block's property away, if there is one."""
    for curves in _lists_of_curves(block):
        curve = curves.find(path)
        if curve is not None:
            curves.remove(curve)


def own_action(block, created):
    """Gives a data-block a copy of its action, which a copy of a data-block shares with the
    original. `created` gets it."""
    data = None if block is None else block.animation_data
    if data is None:
        return
    data.use_tweak_mode = False  # of a strip, whose action can't be changed
    if data.action is None:
        return
    slot = getattr(data, "action_slot", None)
    name = None if slot is None else slot.identifier
    action = data.action.copy()
    created(action)
    data.action = action
    if name is not None:
        data.action_slot = next(slot for slot in action.slots if slot.identifier == name)


def _lists_of_curves(block):
    """Since Blender 5.0 an action has curves by slot alone."""
    data = block.animation_data
    if data is None or data.action is None:
        return []
    slot = getattr(data, "action_slot", None)
    if slot is None:
        return [data.action.fcurves] if hasattr(data.action, "fcurves") else []
    strips = (strip for layer in data.action.layers for strip in layer.strips)
    bags = (strip.channelbag(slot) for strip in strips)
    return [bag.fcurves for bag in bags if bag is not None]


# --- Materials ------------------------------------------------------------------------------------


def node_tree(material):
    """The nodes of a new material, which has them by itself since Blender 5.0."""
    if material.node_tree is None or not uses_nodes(material):
        material.use_nodes = True
    return material.node_tree


def uses_nodes(material):
    """Whether a material's nodes say what it looks like: always, since Blender 5.0."""
    return material.node_tree is not None and (is_at_least(5, 0) or material.use_nodes)
