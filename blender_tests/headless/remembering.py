"""What the library has computed for a test, for the next that asks the same; also for another
Blender's, which shares a folder with this one's."""

import hashlib
import io
import pickle
import secrets
from dataclasses import replace
from pathlib import Path

import numpy as np

PROTOCOL = 4
"""Of what Blenders leave for each other: what numpy 1 and numpy 2 write with it, both can read."""


class _Words(pickle.Pickler):
    """Pickles arrays in words that are the same for any version of numpy."""

    def reducer_override(self, obj):
        if isinstance(obj, np.ndarray | np.generic) and not obj.dtype.hasobject:
            return np.ndarray, (obj.shape, obj.dtype.str, obj.tobytes())
        return NotImplemented


def words_of(question):
    """What is asked, in the same words for any Blender's Python."""
    words = io.BytesIO()
    _Words(words, PROTOCOL).dump(question)
    return words.getvalue()


class Memory:
    """Answers, in a folder."""

    def __init__(self, folder):
        self._folder = Path(folder)

    def answer(self, question, compute):
        """What `compute()` returned the first time that this was asked."""
        known = self._folder / hashlib.sha256(words_of(question)).hexdigest()
        if not known.exists():
            new = known.with_suffix(f".{secrets.token_hex(8)}")
            new.write_bytes(pickle.dumps(compute(), protocol=PROTOCOL))
            new.replace(known)
        return pickle.loads(known.read_bytes())

    def remembering(self, compute):
        """`computation.compute`, which computes nothing twice."""

        def remembered(request, progress, earlier=None):
            of = getattr(earlier, "request", None)  # what a finer source starts from has none
            before = earlier and (of and of.without_looks(), earlier.maps)
            question = request.without_looks(), before
            return self.answer(question, lambda: compute(request, progress, earlier))

        return remembered

    def remembering_finer(self, compute):
        """`denser_source.compute`, which cuts no source twice."""

        def remembered(request, stops, progress):
            bare = [replace(stop, shape=replace(stop.shape, skin=None)) for stop in stops]
            question = "finer", request.without_looks(), bare
            return self.answer(question, lambda: compute(request, stops, progress))

        return remembered
