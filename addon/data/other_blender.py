"""Another Blender, without a window, that works while this one goes on."""

import os
import subprocess
import tempfile

import bpy

WAITING = "Baking colors"


def command():
    """The words that run a script in it; None where there is no window that would wait, or no
    Blender to start."""
    if bpy.app.background or not bpy.app.binary_path:
        return None
    words = ["--background", "--factory-startup", "--python-exit-code", "1", "--python"]
    return [bpy.app.binary_path, *words]


def run_steps(script, *arguments):
    """A generator that yields words until a script has ended, and stops it if it isn't waited for.

    Returns
    -------
    str or None
        What it said last, where it failed.
    """
    words = [*command(), script, "--", *arguments]
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            creationflags=flags,
        )
        try:
            while process.poll() is None:
                yield WAITING
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        if process.returncode == 0:
            return None
        said.seek(0)
        lines = said.read().decode(errors="replace").split(os.linesep)
        return next((line.strip() for line in lines[::-1] if line.strip()), "nothing")
