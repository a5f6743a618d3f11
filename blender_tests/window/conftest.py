"""A Blender with a window on a screen of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

import installing
from driven_window import BLENDER, Window
from steps import RUNNING, VIEWPORT

SIZE = (720, 800)
"""Pixels of the screen. Without a graphics card, drawing takes as long as there are many."""

PROGRAMS = ("Xvfb", "xdotool", "import")


@pytest.fixture(scope="session")
def output():
    """A folder for pictures that outlive the tests."""
    folder = Path(os.environ.get("POINTMORPH_OUTPUT", installing.ROOT / "build" / "blender_tests"))
    folder = folder / "window"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def user_environment(folder):
    """For a Blender whose user has never started it before."""
    missing = [program for program in (*PROGRAMS, BLENDER) if shutil.which(program) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}")
    environment = {**os.environ, **installing.user_folders(folder), "LIBGL_ALWAYS_SOFTWARE": "1"}
    environment["POINTMORPH_SCENES"] = str(HERE.parent / "headless")
    environment.setdefault("POINTMORPH_COMPUTED", str(folder))
    return environment


@pytest.fixture(scope="session")
def environment(tmp_path_factory):
    """For a Blender in which the add-on is installed and enabled."""
    folder = tmp_path_factory.mktemp("user")
    environment = user_environment(folder)
    if "POINTMORPH_ZIP" not in os.environ:
        startup = folder / "scripts" / "startup"
        startup.mkdir()
        (startup / "library.py").write_text(
            f"import sys\nsys.path.extend({installing.library_paths()})\n"
            "def register(): pass\ndef unregister(): pass\n"
        )
    paths = f"import sys; sys.path.insert(0, {str(HERE.parent)!r})"
    script = ("--python-expr", paths, "--python", str(HERE / "prepare.py"))
    command = (BLENDER, "--background", "--python-exit-code", "1", *script)
    subprocess.run(command, env=environment, check=True)
    return environment


@pytest.fixture(scope="session")
def size():
    """Pixels of the screen: with a width of 1000, there is room for all of Blender's areas."""
    return SIZE


@pytest.fixture(scope="session")
def screen(size):
    """A screen without a screen: its name, and its size."""
    read_end, write_end = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write_end), "-screen", "0", "{}x{}x24".format(*size)],
        pass_fds=[write_end],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        number = pipe.readline().strip()
    yield f":{number}", size
    server.terminate()
    server.wait()


_FAILED = pytest.StashKey[bool]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    item.stash[_FAILED] = item.stash.get(_FAILED, False) or report.failed
    return report


@pytest.fixture(scope="session")
def _shared():
    """The Blender that tests use one after another, while none is using it."""
    windows = []
    yield windows
    for window in windows:
        window.kill()


@pytest.fixture
def window(request, _shared, screen, environment, output, tmp_path_factory):
    """Blender with an empty scene."""
    if _shared:
        window = _shared.pop()
    else:
        window = Window(screen, environment, output, tmp_path_factory.mktemp("shared"))
    # What a failure leaves, a dialog or a panel that is folded, is not for the next test: Blender
    # is handed on only after a test that passed.
    try:
        # It keeps a button as it is, grayed for instance, while the mouse is over it.
        window.leave_sidebar()
        # The report of an error may stay until the mouse has been over it.
        window.press("Escape", over=VIEWPORT)
        window.start()
        window.remember(not request.node.get_closest_marker("computes"))
        yield window
        if not request.node.stash[_FAILED] and window.process.poll() is None:
            window.wait(f"not ({RUNNING})")
            _shared.append(window)
    finally:
        if not _shared:
            window.kill()


@pytest.fixture
def new_users_window(_shared, screen, output, tmp_path):
    """Blender as it is when it was just installed."""
    while _shared:  # two at a time would slow each other down
        _shared.pop().kill()
    environment = user_environment(tmp_path / "user")
    window = Window(screen, environment, output, tmp_path, has_addon=False)
    yield window
    window.kill()


@pytest.fixture
def changed_window(request, window):
    """The same for a test that opens or saves a file, disables the add-on or ends Blender."""
    yield window
    if not request.node.stash[_FAILED] and window.process.poll() is None:
        window.run("bpy.ops.wm.read_homefile(use_empty=True)")
        window.start()
