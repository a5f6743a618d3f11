"""Bodies of one piece made by script, whose every point knows where it belongs on another draw.

Each is a union of parts (see `made_shapes`), sampled where it can be seen from outside: hands,
birds, furniture, vehicles and vessels, none of which looks the same when it is turned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pointmorph
from made_shapes import Floats, Ints, Part, Random, bent, icosphere, rotation, surface_of
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Body:
    positions: Floats
    """(N, 3)"""
    normals: Floats
    """(N, 3)"""
    truth: Floats
    """(N, 3) where each belongs on the other body"""
    is_shared: np.ndarray
    """(N,) whether that place can be seen there"""
    parts: Ints
    """(N,)"""

    def cloud(self) -> pointmorph.Cloud:
        return pointmorph.Cloud(self.positions, normals=self.normals)


def hand(random: Random) -> list[Part]:
    w, h, thick = random.uniform([0.75, 0.8, 0.16], [1.0, 1.1, 0.22])
    parts = [
        Part("palm", (0, 0, 0), (w / 2, thick, h / 2), 0.7),
        Part("wrist", (0, 0, -0.6 * h), (0.33 * w, 0.9 * thick, 0.4 * h), 0.8),
    ]
    curl = random.uniform(0.0, 0.35)
    for k, length in enumerate((0.75, 0.95, 1.05, 0.9)):
        root = np.array(((0.5 - (k + 0.5) / 4) * 0.92 * w, 0.0, 0.42 * h))
        spread = (1.5 - k) * random.uniform(0.02, 0.12)
        bend, at = 0.0, root
        for joint, share in enumerate((0.45, 0.32, 0.28)):
            bend += curl
            turn = rotation((0, spread, 0)) @ rotation((bend, 0, 0))
            half = 0.5 * share * length * h
            middle = at + turn @ (0, 0, half)
            vector = rotation_vector(turn)
            parts.append(Part(f"finger {k} {joint}", tuple(middle),
                              (0.11 * w, 0.11 * w, 1.25 * half), 0.8, vector))  # fmt: skip
            at = at + turn @ (0, 0, 2 * half)
    at = np.array((-0.45 * w, 0.0, -0.25 * h))
    for joint, share in enumerate((0.4, 0.35)):
        turn = rotation((0.3 + 0.3 * joint, -0.9 + 0.25 * joint, 0))
        half = 0.5 * share * h
        vector = rotation_vector(turn)
        parts.append(Part(f"thumb {joint}", tuple(at + turn @ (0, 0, half)),
                          (0.14 * w, 0.14 * w, 1.3 * half), 0.8, vector))  # fmt: skip
        at = at + turn @ (0, 0, 2 * half)
    return parts


def rotation_vector(turn: Floats) -> tuple[float, float, float]:
    """The rotation vector of a rotation."""
    x, y, z = Rotation.from_matrix(turn).as_rotvec()
    return float(x), float(y), float(z)


def bird(random: Random) -> list[Part]:
    length, fat, span = random.uniform([0.9, 0.3, 0.7], [1.3, 0.45, 1.2])
    lift, neck = random.uniform([-0.2, 0.15], [0.5, 0.4])
    head = np.array((length / 2 + 0.5 * neck, 0, 0.3 + neck))
    parts = [
        Part("body", (0, 0, 0), (length / 2 + 0.1, fat, fat), 1.0),
        Part("neck", (length / 2 + 0.1 * neck, 0, 0.15 + neck / 2), (0.13, 0.12, 0.2 + neck / 2)),
        Part("head", tuple(head), (0.23, 0.18, 0.18), 1.0),
        Part("beak", (head[0] + 0.33, 0, head[2] - 0.03), (0.2, 0.06, 0.05), 1.0),
        Part("tail", (-0.75 * length, 0, 0.05), (0.35 * length, 0.2, 0.05), 0.8, (0, 0.2, 0)),
    ]
    for y in (-1, 1):
        turn = y * lift
        middle = (0.05, y * (fat + span / 2 - 0.1), 0.1 + lift * span / 2)
        parts.append(Part(f"wing {y}", middle, (0.27, span / 2 + 0.1, 0.05), 0.9, (turn, 0, 0)))
        tip = (-0.08, y * (fat + 1.25 * span - 0.2), 0.1 + 1.1 * lift * span)
        parts.append(Part(f"wing tip {y}", tip, (0.2, 0.35 * span, 0.04), 1.0,
                          (0.7 * turn, 0, y * 0.25)))  # fmt: skip
        parts.append(Part(f"leg {y}", (-0.05, y * 0.15, -fat - 0.15), (0.06, 0.06, 0.3), 0.8))
        parts.append(Part(f"foot {y}", (0.05, y * 0.15, -fat - 0.42), (0.17, 0.1, 0.05), 0.8))
    return parts


def chair(random: Random) -> list[Part]:
    w, d, h, back = random.uniform([0.8, 0.7, 0.6, 0.8], [1.2, 1.1, 1.0, 1.4])
    leg = random.uniform(0.06, 0.1)
    parts = [
        Part("seat", (0, 0, h), (w / 2, d / 2, 0.08)),
        Part("back", (0, -d / 2 + 0.06, h + back / 2), (w / 2, 0.08, back / 2), 0.4),
    ]
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (w / 2 - leg), y * (d / 2 - leg), h / 2)
            parts.append(Part(f"leg {x} {y}", at, (leg, leg, h / 2)))
        parts.append(Part(f"arm {x}", (x * (w / 2 - 0.05), 0, h + 0.35), (0.06, d / 2, 0.06)))
        parts.append(Part(f"post {x}", (x * (w / 2 - 0.05), d / 2 - 0.1, h + 0.18),
                          (0.05, 0.05, 0.22)))  # fmt: skip
    return parts


def desk(random: Random) -> list[Part]:
    w, d, h, box = random.uniform([1.4, 0.7, 0.7, 0.35], [2.2, 1.1, 1.0, 0.6])
    parts = [
        Part("top", (0, 0, h), (w / 2, d / 2, 0.07)),
        Part("drawers", (w / 2 - box / 2 - 0.03, 0, 0.55 * h), (box / 2, 0.44 * d, 0.47 * h)),
        Part("back", (0, 0.42 * d, 0.75 * h), (0.46 * w, 0.05, 0.25 * h)),
        Part("lamp foot", (-0.35 * w, 0.2 * d, h + 0.25), (0.06, 0.06, 0.3), 0.7),
        Part("lamp", (-0.35 * w + 0.1, 0.1 * d, h + 0.55), (0.22, 0.16, 0.13), 1.0),
    ]
    for y in (-1, 1):
        parts.append(
            Part(f"leg {y}", (-w / 2 + 0.1, y * (d / 2 - 0.1), h / 2), (0.08, 0.08, h / 2))
        )
    return parts


def car(random: Random) -> list[Part]:
    length, w, h = random.uniform([3.2, 1.4, 0.55], [4.6, 1.9, 0.9])
    wheel, cabin = random.uniform([0.32, 0.2], [0.45, 0.34])
    back = random.uniform(-0.2, -0.1) * length
    parts = [
        Part("body", (0, 0, wheel + h / 2), (length / 2, w / 2, h / 2), 0.4),
        Part("cabin", (back, 0, wheel + 1.2 * h), (cabin * length, 0.42 * w, 0.5 * h), 0.5),
        Part("spoiler", (-0.46 * length, 0, wheel + 1.2 * h), (0.2, 0.4 * w, 0.08 + 0.2 * h), 0.5),
    ]
    for y in (-1, 1):
        for x in (-0.3, 0.31):
            at = (x * length, y * (w / 2 - 0.02), wheel)
            parts.append(Part(f"wheel {x} {y}", at, (wheel, 0.16, wheel), 0.8))
        at = (0.12 * length, y * (w / 2 + 0.1), wheel + 0.95 * h)
        parts.append(Part(f"mirror {y}", at, (0.1, 0.2, 0.1), 0.8))
    return parts


def plane(random: Random) -> list[Part]:
    length, span, thick, swept = random.uniform([3.2, 1.5, 0.27, 0.0], [4.6, 2.4, 0.42, 0.5])
    parts = [
        Part("hull", (0, 0, 0), (length / 2, thick, thick), 0.9),
        Part("cockpit", (0.25 * length, 0, 0.8 * thick), (0.4, 0.2, 0.22), 1.0),
        Part("fin", (-0.42 * length, 0, thick + 0.2), (0.26, 0.07, 0.5), 0.7),
    ]
    for y in (-1, 1):
        turn = (0.0, 0.0, -y * swept)
        wing = (0.02 * length - 0.4 * swept, y * (thick + span / 2 - 0.1), 0.0)
        parts.append(Part(f"wing {y}", wing, (0.38, span / 2 + 0.1, 0.08), 0.6, turn))
        parts.append(Part(f"tail wing {y}", (-0.43 * length, y * 0.45, 0.05), (0.2, 0.45, 0.07),
                          0.6))  # fmt: skip
        at = (0.08 * length, y * (thick + 0.45 * span), -0.17)
        parts.append(Part(f"engine {y}", at, (0.42, 0.17, 0.17), 0.8))
    return parts


def kettle(random: Random) -> list[Part]:
    fat, h, spout = random.uniform([0.7, 0.6, 0.45], [1.0, 0.9, 0.7])
    parts = [
        Part("belly", (0, 0, 0), (fat, fat, h), 0.8),
        Part("lid", (0, 0, h), (0.5 * fat, 0.5 * fat, 0.12), 0.9),
        Part("knob", (0, 0, h + 0.17), (0.12, 0.12, 0.12), 1.0),
        Part("spout", (fat + 0.25 * spout, 0, 0.2), (0.14, 0.14, spout), 0.8, (0, 0.7, 0)),
    ]
    for k in range(5):
        a = np.pi * (0.5 + k / 4)
        at = (-fat + 0.1 + 0.45 * np.cos(a), 0, 0.1 + 0.5 * h * np.sin(a))
        parts.append(Part(f"handle {k}", at, (0.1, 0.1, 0.33 * h), 0.9, (0, np.pi / 2 - a, 0)))
    return parts


Family = Callable[[Random], list[Part]]
FAMILIES: dict[str, tuple[Family, ...]] = {
    "hands": (hand,),
    "birds": (bird,),
    "furniture": (chair, desk),
    "vehicles": (car, plane),
    "vessels": (kettle,),
}


def is_inside(part: Part, positions: Floats) -> np.ndarray:
    at = np.abs((positions - part.middle) @ rotation(part.turn)) / part.half
    inside: np.ndarray = (at ** (2 / part.exponent)).sum(axis=1) < 1 - 1e-9
    return inside


def visible(parts: list[Part], of: Ints, positions: Floats) -> np.ndarray:
    """Whether each is on the surface of what parts add, and hollow ones take away, one by one."""
    seen = np.ones(len(positions), dtype=bool)
    solid = np.zeros(len(positions), dtype=bool)
    for number, part in enumerate(parts):
        own, inside = of == number, is_inside(part, positions)
        seen[own] = solid[own] == part.is_hollow
        seen[(of < number) & inside] = False
        solid[inside] = not part.is_hollow
    return seen


def body_pair(family: Family, seed: int, points: int, strength: float = 1.0) -> tuple[Body, Body]:
    """Two draws, the second one bent, twisted and tapered, turned any way."""
    random = np.random.default_rng(seed)
    draws = [family(random) for _ in range(2)]
    directions, faces = icosphere(3)
    rows = np.concatenate([faces + k * len(directions) for k in range(len(draws[0]))])
    of = np.repeat(np.arange(len(draws[0])), len(faces))
    plain = [np.concatenate([surface_of(part, directions) for part in draw]) for draw in draws]
    shown = [plain[0], bent(plain[1], random, strength)]
    bodies = []
    for here, there in ((0, 1), (1, 0)):
        corners = shown[here][rows]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1)
        chosen = random.choice(len(area), 4 * points, p=area / area.sum())
        weights = random.dirichlet(np.ones(3), 4 * points)[:, :, None]
        at, plainly, elsewhere, there_plainly = (
            (positions[rows[chosen]] * weights).sum(axis=1)
            for positions in (shown[here], plain[here], shown[there], plain[there])
        )
        seen = np.flatnonzero(visible(draws[here], of[chosen], plainly))[:points]
        shared = visible(draws[there], of[chosen[seen]], there_plainly[seen])
        normals = cross[chosen[seen]] / np.maximum(area[chosen[seen]], 1e-300)[:, None]
        normals[np.array([part.is_hollow for part in draws[here]])[of[chosen[seen]]]] *= -1
        bodies.append(Body(at[seen], normals, elsewhere[seen], shared, of[chosen[seen]]))
    return bodies[0], bodies[1]
