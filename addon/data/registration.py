"""What a module gives to Blender, and the one place where it is registered.

A module that has something to register has a `registration`, which the package lists.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent


@dataclass(frozen=True)
class Registration:
    """What one module registers, in this order; it's unregistered in reverse.

    Attributes
    ----------
    start : function
        Called after everything is registered; there may be no file yet.
    stop : function
        Called before anything is unregistered, to end what is still running.
    classes : tuple of type
    properties : tuple of (type, str, property)
        The Blender type that gets the property, and its name there.
    handlers : tuple of (str, function)
        The list in `bpy.app.handlers`, and what is called. All of them outlive the open file.
    drawings : tuple of (function, str)
        What is drawn in 3D viewports, and when: "POST_VIEW" or "POST_PIXEL". Only with a window.
    menus : tuple of (type, function)
        The menu, and what adds to it.
    commands : tuple of (str, function)
        The name after ``blender --command``, and what is called with the words after that.
    """

    start: Callable[[], object] = lambda: None
    stop: Callable[[], object] = lambda: None
    classes: tuple = ()
    properties: tuple = ()
    handlers: tuple = ()
    drawings: tuple = ()
    menus: tuple = ()
    commands: tuple = ()


def on_other_states(function):
    """Handlers that call it when a file is opened, and after undo and redo: what is remembered of
    the objects doesn't hold for these."""
    return tuple((event, function) for event in ("load_post", "undo_post", "redo_post"))


_drawn = []  # what draw_handler_remove() wants
_commands = []  # what unregister_cli_command() wants


def register(registrations):
    for one in registrations:
        for cls in one.classes:
            if issubclass(cls, bpy.types.Operator):
                cls.bl_description = tooltip(cls)
            bpy.utils.register_class(cls)
        for owner, name, value in one.properties:
            setattr(owner, name, value)
        for event, function in one.handlers:
            getattr(bpy.app.handlers, event).append(persistent(function))
        for function, when in () if bpy.app.background else one.drawings:
            _drawn.append(bpy.types.SpaceView3D.draw_handler_add(function, (), "WINDOW", when))
        for menu, function in one.menus:
            menu.append(function)
        for name, function in one.commands:
            _commands.append(bpy.utils.register_cli_command(name, function))
    for one in registrations:
        one.start()


def unregister(registrations):
    for one in registrations:
        one.stop()
    while _drawn:
        bpy.types.SpaceView3D.draw_handler_remove(_drawn.pop(), "WINDOW")
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    for one in reversed(registrations):
        for menu, function in reversed(one.menus):
            menu.remove(function)
        for event, function in reversed(one.handlers):
            getattr(bpy.app.handlers, event).remove(function)
        for owner, name, _ in reversed(one.properties):
            delattr(owner, name)
        for cls in reversed(one.classes):
            bpy.utils.unregister_class(cls)


def tooltip(operator):
    """What an operator's docstring says, in one line."""
    return " ".join((inspect.getdoc(operator) or "").split())


def stop_timer(function):
    """Ends a timer that may be running."""
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)
