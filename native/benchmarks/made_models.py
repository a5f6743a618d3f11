"""Heads with open mouths, airplanes of unlike builds, and beasts that lack limbs, made by script.

As with `made_bodies`, every point knows where it belongs on the other one of a pair.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from made_bodies import Body, body_pair
from made_figures import FIGURES, figure_pair, limb_numbers
from made_shapes import Floats, Ints, MadePair, Part, Random, Side, bent
from scipy.sparse import csgraph

Marks = dict[str, tuple[int, int]]

HEAD_MARKS = {
    "nose": ("nose", (0, 1, 0)),
    "chin": ("jaw", (0, 0.5, -1)),
    "crown": ("skull", (0, 0, 1)),
    "right ear": ("ear 1", (1, 0, 1)),
    "left ear": ("ear -1", (-1, 0, 1)),
    "right eye": ("eye 1", (0, 1, 0)),
    "left eye": ("eye -1", (0, 1, 0)),
    "right corner of the mouth": ("mouth", (1, 0.3, 0)),
    "left corner of the mouth": ("mouth", (-1, 0.3, 0)),
}
"""On which part each lies, and the direction in which it is the farthest point of that part."""


def head(random: Random) -> list[Part]:
    """A mouth with lips that nearly touch, a tongue in it, ears, a nose, eyes and a neck."""
    broad, deep, tall, jaw = random.uniform([0.5, 0.65, 0.7, 0.33], [0.65, 0.85, 0.9, 0.48])
    gap, wide, lip = random.uniform([0.015, 0.18, 0.035], [0.12, 0.27, 0.06])
    nose, ear, thick = random.uniform([0.12, 0.16, 0.25], [0.22, 0.26, 0.36])
    low, front = -0.22, 0.3 + jaw
    parts = [
        Part("skull", (0, 0, 0.35), (broad, deep, tall), 1.0),
        Part("neck", (0, -0.15, -0.7), (thick, 1.05 * thick, 0.6), 0.6),
        Part("jaw", (0, 0.3, -0.23 - gap), (0.75 * broad, jaw, 0.36), 0.9),
        Part("nose", (0, front + 0.02, 0.1), (0.09, nose, 0.14), 1.0, (-0.3, 0, 0)),
    ]
    for x in (-1, 1):
        parts.append(Part(f"eye {x}", (x * 0.22, 0.82 * deep, 0.33), (0.1, 0.1, 0.07), 1.0))
        parts.append(Part(f"ear {x}", (x * (broad + 0.03), -0.05, 0.2), (0.05, 0.13, ear), 0.9,
                          (0, x * 0.3, 0)))  # fmt: skip
    for z, name in ((1, "upper lip"), (-1, "lower lip")):
        at = (0, front - 0.04, low + z * (gap + 0.8 * lip))
        parts.append(Part(name, at, (1.1 * wide, 1.6 * lip, lip), 0.9))
    parts.append(Part("mouth", (0, front - 0.25, low), (wide, 0.45, gap), 0.7, is_hollow=True))
    parts.append(Part("throat", (0, front - 0.4, low), (wide, 0.25, 0.14), 0.9, is_hollow=True))
    parts.append(Part("tongue", (0, front - 0.4, low - 0.1), (0.6 * wide, 0.24, 0.07), 0.9))
    return parts


def head_pair(seed: int, points: int) -> tuple[Body, Body, Marks]:
    """Two builds that look the same way, and marks."""
    source, target = body_pair(head, seed, points, strength=0.3)
    names = [part.name for part in head(np.random.default_rng(0))]
    marks: Marks = {}
    for word, (part, along) in HEAD_MARKS.items():
        of = np.flatnonzero((source.parts == names.index(part)) & source.is_shared)
        row = int(of[(source.positions[of] @ along).argmax()])
        marks[word] = row, nearest_row(target, source.truth[row])
    return source, target, marks


def nearest_row(body: Body, place: np.ndarray) -> int:
    return int(((body.positions - place) ** 2).sum(axis=1).argmin())


def airplane(random: Random) -> list[Part]:
    """High or low wings, straight or swept, short or long; the tail wing anywhere on the fin."""
    length, span, thick, swept = random.uniform([3.0, 1.1, 0.2, 0.0], [6.0, 2.8, 0.45, 0.7])
    high, place, chord = random.uniform([-0.7, -0.05, 0.25], [0.7, 0.08, 0.5])
    fin, tail, out = random.uniform([0.35, 0.0, 0.3], [0.7, 1.0, 0.6])
    back = -0.43 * length
    parts = [
        Part("hull", (0, 0, 0), (length / 2, thick, thick), 0.8),
        Part("cockpit", (0.27 * length, 0, 0.75 * thick), (0.4, 0.2, 0.22), 1.0),
        Part("fin", (back, 0, thick + 0.5 * fin), (0.26, 0.07, 0.7 * fin), 0.7),
    ]
    for y in (-1, 1):
        turn = (0.0, 0.0, -y * swept)
        middle = span / 2 - 0.1
        wing = (place * length - np.sin(swept) * middle, y * (0.5 * thick + middle), high * thick)
        parts.append(Part(f"wing {y}", wing, (chord, span / 2 + 0.15, 0.08), 0.6, turn))
        at = (back, y * 0.4, tail * (thick + fin))
        parts.append(Part(f"tail wing {y}", at, (0.2, 0.45, 0.07), 0.6, turn))
        along = out * span
        engine = (place * length - np.tan(swept) * along + 0.2, y * (0.5 * thick + along),
                  high * thick - 0.2)  # fmt: skip
        parts.append(Part(f"engine {y}", engine, (0.4, 0.17, 0.17), 0.8))
    return parts


LOST = (("leg 1 1", "tail"), ("leg -1 -1",), ("tail",), ("neck", "head", "ear -1", "ear 1"))
"""What beasts lack, by turns."""
TIP = 0.3
"""How far along the surface a tip is cut away, in √area."""


def cut_pair(seed: int, points: int) -> tuple[Body, Body]:
    """A beast from which limbs are cut, and the whole one in another pose."""
    source, target = figure_pair(FIGURES["beasts"], seed, points)
    names, limbs = limb_numbers(FIGURES["beasts"], seed)
    lost = [names.index(name) for name in LOST[seed % len(LOST)]]
    kept = ~np.isin(limbs[source.parts], lost)
    left = {name: getattr(source, name)[kept] for name in vars(source)}
    has = target.is_shared & ~np.isin(limbs[target.parts], lost)
    return replace(source, **left), replace(target, is_shared=has)


ALONE = (
    ("people", ("head", "nose")),
    ("beasts", ("neck", "head", "ear")),
    ("people", ("chest", "head", "nose", "arm", "hand")),
    ("beasts", ("head", "ear")),
)
"""Figures, and how the names of the parts begin that are alone, by turns."""


def alone_pair(seed: int, points: int) -> tuple[Body, Body]:
    """A part of a figure, and a whole one of another build in another pose."""
    kind, words = ALONE[seed % len(ALONE)]
    names = [part.name for part in FIGURES[kind](*(np.random.default_rng(0) for _ in range(2)))]
    alone = [number for number, name in enumerate(names) if name.startswith(words)]

    def both(count: int) -> tuple[Body, Body]:
        return body_pair(lambda draw: FIGURES[kind](draw, draw), 50 + seed, count, strength=0.4)

    share = np.isin(both(points)[0].parts, alone).mean()
    source, target = both(int(1.2 * points / share))
    rows = np.flatnonzero(np.isin(source.parts, alone))[:points]
    part = {name: getattr(source, name)[rows] for name in vars(source)}
    whole = {name: getattr(target, name)[:points] for name in vars(target)}
    whole["is_shared"] = whole["is_shared"] & np.isin(whole["parts"], alone)
    return Body(**part), Body(**whole)


def airplane_pair(seed: int, points: int) -> tuple[Body, Body]:
    """Two airplanes. Points of their hulls are not shared: a share of a hull's length says
    something else of them than what they lie next to, since wings stand elsewhere along it."""
    pair = body_pair(airplane, seed, points, strength=0.0)
    hull = 0
    for body in pair:
        body.is_shared[body.parts == hull] = False
    return pair


def lopped_pair(positions: Floats, faces: Ints, tips: int, random: Random) -> MadePair:
    """A mesh whose farthest tips are cut away, and the whole of it, bent and turned."""
    edges = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1)
    edges = np.unique(edges, axis=0)
    corners = positions[edges]
    lengths = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    graph = sp.csr_matrix((lengths, (edges[:, 0], edges[:, 1])), (len(positions),) * 2)
    graph = graph.maximum(graph.T)
    middle = ((positions - positions.mean(axis=0)) ** 2).sum(axis=1).argmin()
    away = csgraph.dijkstra(graph, indices=middle)
    across = np.cross(*(positions[faces[:, k]] - positions[faces[:, 0]] for k in (1, 2)))
    reach = TIP * np.sqrt(np.linalg.norm(across, axis=1).sum() / 2)
    lost = np.zeros(len(positions), dtype=bool)
    for _ in range(tips):
        tip = np.where(lost, 0, away).argmax()
        from_it = csgraph.dijkstra(graph, indices=tip)
        lost |= from_it < reach
        away = np.minimum(away, from_it)
    parts = lost[faces].any(axis=1).astype(np.int64)
    whole = Side(bent(positions, random, 0.7), faces, parts)
    return MadePair("lopped", Side(positions, faces[parts == 0], parts[parts == 0]), whole,
                    only_on_target=frozenset({1}))  # fmt: skip
