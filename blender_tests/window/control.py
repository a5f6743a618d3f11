"""Runs in the Blender with a window: does what the tests ask for over a socket, between redraws."""

import json
import os
import socket
import sys
import traceback

import bpy

_socket = socket.socket(socket.AF_UNIX)
_socket.connect(os.environ["POINTMORPH_CONTROL"])
_socket.setblocking(False)
_received = b""
_names = {"bpy": bpy}


def _answer(code):
    try:
        exec(code, _names)
        answer = {"value": _names.pop("answer", None)}
    except Exception:
        answer = {"error": traceback.format_exc()}
    _socket.setblocking(True)
    _socket.sendall(json.dumps(answer).encode() + b"\n")
    _socket.setblocking(False)


def _poll():
    global _received
    try:
        received = _socket.recv(1 << 20)
    except BlockingIOError:
        return 0.002
    if not received:
        bpy.ops.wm.quit_blender()
    _received += received
    *commands, _received = _received.split(b"\n")
    for command in commands:
        _answer(json.loads(command))
    return 0.002


sys.path.insert(0, os.environ["POINTMORPH_SCENES"])
bpy.app.timers.register(_poll, persistent=True)
