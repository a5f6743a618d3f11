"""A Blender with a window that tests drive: by mouse, keyboard and code, with a camera."""

import json
import os
import socket
import subprocess
import time
from pathlib import Path

from steps import VIEWPORT

HERE = Path(__file__).resolve().parent

PATIENCE = 300.0
"""Seconds after which what is waited for won't come: no measure of how long it should take."""
BLENDER = os.environ.get("POINTMORPH_BLENDER", "blender")

START = (HERE / "fresh_scene.py").read_text()
CLOSE_OTHER_AREAS = """
for other in [other for other in window.screen.areas if other.type != "VIEW_3D"]:
    with bpy.context.temp_override(window=window, area=other):
        bpy.ops.screen.area_close()
"""


class Window:
    """A running Blender.

    Positions are those of a screenshot: pixels from the top left corner of the window. Buttons are
    found by hovering, so that a new row in a panel doesn't move them from under the mouse.
    """

    _places, _tabs = {}, []  # they lie at much the same place in the next Blender

    def __init__(self, screen, environment, output, folder, has_addon=True):
        display, size = screen
        self._environment = {**environment, "DISPLAY": display}
        self._output = output
        path = str(folder / "control")
        server = socket.socket(socket.AF_UNIX)
        server.bind(path)
        server.listen(1)
        server.settimeout(1)
        self._log = (folder / "log.txt").open("w+")
        self.process = subprocess.Popen(
            [BLENDER, "--window-geometry", "0", "0", *map(str, size), "-P", HERE / "control.py"],
            env={**self._environment, "POINTMORPH_CONTROL": path},
            stdout=self._log,
            stderr=subprocess.STDOUT,
        )
        self._connection = self._accepted(server)
        server.close()
        self._connection.settimeout(PATIENCE)
        self._received = b""
        self._headers = {}
        if has_addon:
            self.start()

    def start(self):
        """An empty scene; what the tests call things in Blender."""
        self.run(START)
        self.redraw()  # an area that was never drawn can't be closed
        if self.ask("is_small and len(window.screen.areas) > 1"):
            self.run(CLOSE_OTHER_AREAS)
            self.redraw()

    def remember(self, remembers):
        """Whether a morph that some Blender's tests have computed isn't computed again, from here
        on; but for one that starts from the last."""
        self.run(f"remember({remembers})")

    def _accepted(self, server):
        """The connection that Blender makes once it is up."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                return server.accept()[0]
            except TimeoutError:
                ended = self.process.poll() is not None
                if ended or time.monotonic() > end:
                    self.process.kill()
                    raise AssertionError(
                        f"Blender {'ended' if ended else 'did not start'}:\n{self.log}"
                    ) from None

    @property
    def log(self):
        """What Blender has printed."""
        self._log.seek(0)
        return self._log.read()

    def send(self, code):
        """Has Blender execute Python, without waiting for it."""
        self._connection.sendall(json.dumps(code).encode() + b"\n")

    def run(self, code):
        """Has Blender execute Python; returns what it assigned to `answer`."""
        self.send(code)
        while b"\n" not in self._received:
            received = self._connection.recv(1 << 20)
            assert received, f"Blender ended:\n{self.log}"
            self._received += received
        line, self._received = self._received.split(b"\n", 1)
        answer = json.loads(line)
        assert "error" not in answer, answer["error"]
        return answer["value"]

    def ask(self, expression):
        """Value of a Python expression in Blender."""
        return self.run(f"answer = {expression}")

    def wait(self, expression):
        """Until a Python expression is true in Blender; long enough for a busy machine."""
        end = time.monotonic() + PATIENCE
        pause = 0.001
        while not (value := self.ask(expression)):
            assert time.monotonic() < end, f"{expression} stayed {value!r}\n{self.log}"
            time.sleep(pause)
            pause = min(2 * pause, 0.02)

    def redraw(self):
        """Until Blender has drawn viewport and sidebar anew."""
        self.run("redraw(viewport, sidebar)")
        self.wait("is_drawn()")

    def rest(self):
        """Until panels lie where they stay: they glide there when one above them has grown."""
        self.run("redraw(sidebar); asked = []")  # now at the latest they begin
        self.wait("is_drawn() and rests()")

    def settle(self, turns=3):
        """Until Blender has handled the events that were sent.

        xdotool ends when the server has passed them on. The first answer may come from the turn
        of Blender's main loop before they are read, the second before they are handled.
        """
        for _ in range(turns):
            self.ask("0")

    def _xdotool(self, *words, turns=3):
        subprocess.run(["xdotool", *map(str, words)], env=self._environment, check=True)
        self.settle(turns)

    def click(self, position, holding=None):
        """A click; `holding` is a key that is down meanwhile."""
        self._redraw_at(position)
        self._xdotool("mousemove", *position)
        if holding:
            self._xdotool("keydown", holding)
        self._xdotool("mousedown", 1, "mouseup", 1)
        if holding:  # Blender looks only then whether it is down
            self._xdotool("keyup", holding)

    def _redraw_at(self, position):
        """Until what lies at a position is drawn as it is: buttons are where they are drawn."""
        x, y = position
        self.run(f"redraw(region_at({x}, {y}))")
        self.wait("is_drawn()")

    def drag(self, start, end, steps=8):
        self._redraw_at(start)
        self._xdotool("mousemove", *start)
        self._xdotool("mousedown", 1)
        for step in range(1, steps + 1):
            at = (a + (b - a) * step // steps for a, b in zip(start, end, strict=True))
            self._xdotool("mousemove", *at, turns=1)
        self._xdotool("mouseup", 1)

    def press(self, key, over):
        """A key, with the mouse over a place: Blender gives it to what lies there."""
        self._xdotool("mousemove", *over)
        self._xdotool("key", key)

    # --- Buttons of the sidebar ---

    def leave_sidebar(self):
        """Moves the mouse over the viewport."""
        self._xdotool("mousemove", *VIEWPORT)
        self.rest()

    def sidebar(self):
        """Left, top, right and bottom of the sidebar without its tabs."""
        return self.ask(
            "(sidebar.x, window.height - sidebar.y - sidebar.height, "
            "sidebar.x + sidebar.width - 22, window.height - sidebar.y)"
        )

    def under(self, position):
        """What the button at a position does: a call of an operator, or the path of a property."""
        x, y = position
        # Moved anew even if it's there already: a button may have been drawn under it meanwhile.
        self._xdotool("mousemove", x - 2, y, "mousemove", x, y)
        return self.ask("hovered()")

    def open_tab(self):
        """Shows the add-on's tab of the sidebar."""
        _, top, right, bottom = self.sidebar()
        for y in (*self._tabs, *range(top + 100, min(top + 420, bottom), 25)):
            if self.ask("sidebar.active_panel_category") == "Pointmorph":
                return
            self.click((right + 12, y))
            self._tabs[:] = [y]
            self.rest()
        self.screenshot("no_tab")
        raise AssertionError("no tab of the sidebar shows the add-on")

    def find(self, what):
        """Position of the button of which `what` is a part of the call or path."""
        self.rest()
        known = [place for call, place in self._places.items() if what in call]
        for place in known:
            if what in self.under(place):
                return place
        left, top, right, bottom = self.sidebar()
        over = (left + right) // 2, top + 40  # below the panels, it would be the viewport
        last, near = known[-1] if known else (right, top)
        # Each row that the mouse is over is drawn anew: first those where it was in another test.
        columns = sorted((right - 50, left + 60, right - 26), key=lambda x: x != last)
        for page in range(3):
            up, down = 4, 5  # buttons of the mouse
            self._scroll(over, *((down, 15) if page else (up, 40)))
            for x in columns:
                rows = self._hover_down(x, top + 8, bottom - 4, what, near)
                for y, call in rows:
                    # Of a wide button, near its right end, from where it can be dragged both ways.
                    if call and x >= self._places.get(call, (0, 0))[0]:
                        self._places[call] = x, y
                if rows and what in rows[-1][1]:
                    return x, rows[-1][0]
        self.screenshot("no_button")
        raise AssertionError(f"no button in the sidebar is {what}: {sorted(self._places)}")

    def _hover_down(self, x, top, bottom, what=None, near=0):
        """What lies under the mouse in a column: (y, call or path or nothing) by row.

        Begins at the row `near`; ends where `what` is a part of the call or path.
        """
        self.run(f"hover_down({x}, {top}, {bottom}, {what!r}, {near})")
        self.wait("hovering is None")
        return [(y, call) for y, call in self.ask("calls")]

    def _scroll(self, over, button, turns):
        self._xdotool("mousemove", *over)
        self._xdotool("click", "--repeat", turns, "--delay", 5, button)
        self.rest()

    def press_button(self, what):
        """Clicks on a button of the sidebar; see `find`."""
        place = self.find(what)
        for _ in range(10):
            # What a timer shows, such as that a result is stale, may have moved it meanwhile.
            self._redraw_at(place)
            if what in self.under(place):
                break
            place = self.find(what)
        self.click(place)

    def open_panel(self, name):
        """Unfolds a panel of the sidebar by a click on its header; `name` is its class."""
        left, top, _, bottom = self.sidebar()
        before = self._panels()
        if name in before:
            return
        rows = self._hover_down(left + 60, top + 8, bottom - 4)
        free = [y for y, call in rows if not call]
        for y in free[::-1]:
            if self.under((left + 60, y)):
                continue  # a panel that was opened or closed has moved a button here
            self.click((left + 60, y))
            after = self._panels()
            if name in after:
                self._headers[name] = left + 60, y
                return
            if after != before:
                self.click((left + 60, y))  # another panel
        raise AssertionError(f"no header opens {name}")

    def close_panel(self, name):
        """Folds a panel that `open_panel` unfolded."""
        self.click(self._headers[name])
        assert name not in self._panels()

    def _panels(self):
        self.run("panels.clear()")
        self.rest()
        return set(self.ask("sorted(panels)"))

    def screenshot(self, name):
        """A picture of the window in the output folder; returns its path."""
        self.redraw()
        self.rest()
        return self.picture(name)

    def picture(self, name):
        """The same of whatever is drawn at the moment."""
        self.settle()
        path = self._output / f"{name}.png"
        subprocess.run(["import", "-window", "root", str(path)], env=self._environment, check=True)
        return path

    def close(self):
        """Quits Blender; returns its exit status."""
        self.send("bpy.ops.wm.quit_blender()")
        try:
            return self.process.wait(PATIENCE)
        finally:
            self.kill()

    def kill(self):
        """Ends Blender, whatever it does."""
        self.process.kill()
        self.process.wait()
        self._connection.close()
        self._log.close()
