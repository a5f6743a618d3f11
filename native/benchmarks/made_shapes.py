"""Pairs of shapes made by script, whose every point knows where it belongs on the other.

Both shapes of a pair are one mesh with two sets of positions, so the same place of the same face is
the truth. They are of many parts that hang loosely together (furniture, vehicles, plants,
creatures), drawn twice from a family with other proportions, bent or twisted, some parts left out;
or of one part, of which a piece is cut away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Random = np.random.Generator
LEVELS = 3
"""How often the faces of an icosahedron are divided in four: 1,280 faces a part."""


@dataclass(frozen=True)
class Part:
    """A superellipsoid: with exponent 1 an ellipsoid, with .2 nearly a box."""

    name: str
    middle: tuple[float, float, float]
    half: tuple[float, float, float]
    exponent: float = 0.3
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector, radians."""
    is_hollow: bool = False
    """Taken away from the parts before it; only in `made_bodies`."""


Family = Callable[[Random], list[Part]]


@dataclass(frozen=True)
class Side:
    positions: Floats
    """(V, 3)"""
    faces: Ints
    """(F, 3)"""
    parts: Ints
    """(F,) the part of each face"""


@dataclass(frozen=True)
class MadePair:
    name: str
    source: Side
    target: Side
    only_on_source: frozenset[int] = field(default_factory=frozenset)
    only_on_target: frozenset[int] = field(default_factory=frozenset)
    """Parts that the other lacks, of which its `positions` are still known."""


@dataclass(frozen=True)
class Samples:
    positions: Floats
    """(N, 3)"""
    normals: Floats
    """(N, 3)"""
    parts: Ints
    """(N,)"""
    truth: Floats
    """(N, 3) where each belongs on the other shape"""
    is_shared: npt.NDArray[np.bool_]
    """(N,) whether the other has the place"""


def icosphere(levels: int) -> tuple[Floats, Ints]:
    golden = (1 + 5**0.5) / 2
    rows = [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    corners = np.array([np.roll(r, k) for k in range(3) for r in rows], dtype=float)
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 1.1
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    rows_of = np.array(faces, dtype=np.int64)
    inward = np.linalg.det(corners[rows_of]) < 0
    rows_of[inward] = rows_of[inward][:, ::-1]
    for _ in range(levels):
        edges = np.sort(rows_of[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        kept, middle = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = rows_of.T
        ab, bc, ca = (middle.reshape(-1, 3) + len(corners)).T
        corners = np.concatenate([corners, corners[kept].mean(axis=1)])
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        rows_of = np.concatenate(
            [np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return corners, rows_of


def rotation(vector: tuple[float, float, float] | Floats) -> Floats:
    """Of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector, dtype=float) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def surface_of(part: Part, directions: Floats) -> Floats:
    rounded = np.sign(directions) * np.abs(directions) ** part.exponent
    # No cube's corners, which would be spikes: between that and the ellipsoid.
    rounded /= np.linalg.norm(rounded, axis=1, ord=2 / part.exponent)[:, None]
    return rounded * part.half @ rotation(part.turn).T + part.middle


def chair(random: Random) -> list[Part]:
    w, d, h, b = random.uniform([0.8, 0.7, 0.7, 0.8], [1.3, 1.2, 1.3, 1.6])
    leg = random.uniform(0.05, 0.09)
    parts = [Part("seat", (0, 0, h), (w / 2, d / 2, 0.07))]
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (w / 2 - leg), y * (d / 2 - leg), h / 2 - 0.08)
            parts.append(Part(f"leg {x} {y}", at, (leg, leg, h / 2 - 0.02)))
        parts.append(Part(f"post {x}", (x * (w / 2 - leg), -d / 2 + leg, h + b / 2 + 0.08),
                          (leg, leg, b / 2)))  # fmt: skip
        parts.append(Part(f"arm {x}", (x * w / 2, 0.05, h + 0.4 * b), (leg, d / 2, 0.05)))
        parts.append(Part(f"holder {x}", (x * w / 2, d / 2 - 0.1, h + 0.2 * b),
                          (0.04, 0.04, 0.18 * b)))  # fmt: skip
        parts.append(Part(f"bar {x}", (x * (w / 2 - leg), 0, 0.35 * h), (0.03, d / 2, 0.03)))
    for k in range(6):
        z = h + 0.15 + b * (k + 0.5) / 6
        parts.append(Part(f"slat {k}", (0, -d / 2 + leg, z), (w / 2 - 0.15, 0.03, 0.28 * b / 6)))
    for k in range(9):
        x = (k - 4) * w / 10.5
        parts.append(Part(f"cushion {k}", (x, 0, h + 0.12), (0.35 * w / 9, 0.4 * d, 0.05), 0.7))
    for x in (-1, 1):
        for y in (-1, 1):
            parts.append(Part(f"foot {x} {y}", (x * (w / 2 - leg), y * (d / 2 - leg), 0.0),
                              (1.3 * leg,) * 3, 1.0))  # fmt: skip
    return parts


def car(random: Random) -> list[Part]:
    length, w, h = random.uniform([3.4, 1.4, 0.5], [5.0, 2.0, 0.8])
    wheel = random.uniform(0.3, 0.42)
    parts = [
        Part("body", (0, 0, wheel + h / 2), (length / 2, w / 2, h / 2), 0.35),
        Part("cabin", (-0.05 * length, 0, wheel + 1.35 * h), (0.27 * length, 0.43 * w, 0.4 * h)),
        Part("exhaust", (-length / 2 - 0.1, -0.3 * w, wheel), (0.25, 0.05, 0.05), 0.6),
        Part("plate", (length / 2 + 0.05, 0, wheel + 0.2 * h), (0.02, 0.3, 0.08)),
        Part("spoiler", (-0.47 * length, 0, wheel + 1.35 * h), (0.15, 0.45 * w, 0.03)),
        Part("antenna", (-0.2 * length, 0.2 * w, wheel + 2.1 * h), (0.02, 0.02, 0.3 * h), 0.7),
    ]
    for y in (-1, 1):
        for x, place in ((-0.3, "rear"), (0.31, "front")):
            at = (x * length, y * (w / 2 + 0.06), wheel)
            parts.append(Part(f"{place} wheel {y}", at, (wheel, 0.12, wheel), 0.8))
            hub = (at[0], at[1] + y * 0.14, at[2])
            parts.append(Part(f"{place} hub {y}", hub, (0.4 * wheel, 0.04, 0.4 * wheel), 0.8))
            for k in range(5):
                a = 2 * np.pi * k / 5
                bolt = (hub[0] + 0.6 * wheel * np.cos(a), hub[1], hub[2] + 0.6 * wheel * np.sin(a))
                parts.append(Part(f"{place} bolt {y} {k}", bolt, (0.05,) * 3, 1.0))
        front, back = length / 2 + 0.03, -length / 2 - 0.03
        parts.append(Part(f"light {y}", (front, y * 0.36 * w, wheel + 0.65 * h),
                          (0.06, 0.16, 0.1), 0.9))  # fmt: skip
        parts.append(Part(f"tail light {y}", (back, y * 0.38 * w, wheel + 0.7 * h),
                          (0.04, 0.13, 0.08)))  # fmt: skip
        parts.append(Part(f"mirror {y}", (0.17 * length, y * (w / 2 + 0.12), wheel + 1.2 * h),
                          (0.06, 0.12, 0.08), 0.6))  # fmt: skip
        parts.append(Part(f"handle {y}", (-0.05 * length, y * (w / 2 + 0.03), wheel + 0.75 * h),
                          (0.15, 0.02, 0.03)))  # fmt: skip
    return parts


def tree(random: Random) -> list[Part]:
    fixed = np.random.default_rng(7)  # the same leaves, in a crown of other proportions
    height, spread, thick = random.uniform([1.6, 0.9, 0.09], [2.4, 1.6, 0.16])
    parts = [Part("trunk", (0, 0, height / 2), (thick, thick, height / 2), 0.5)]
    for k in range(60):
        direction = fixed.normal(size=3)
        direction /= np.linalg.norm(direction)
        at = direction * fixed.uniform(0.55, 1.0) * (spread, spread, 0.7 * spread)
        at += (0, 0, height + 0.55 * spread)
        at += random.normal(size=3) * 0.03
        turn = np.cross((0, 0, 1), direction) + random.normal(size=3) * 0.2
        half = np.array((0.2, 0.12, 0.03)) * spread * fixed.uniform(0.7, 1.2)
        parts.append(Part(f"leaf {k}", tuple(at), tuple(half), 0.8, tuple(turn)))
    return parts


def robot(random: Random) -> list[Part]:
    w, h, d = random.uniform([0.8, 1.0, 0.5], [1.3, 1.5, 0.8])
    arm, leg, neck = random.uniform([0.5, 0.55, 0.1], [0.8, 0.9, 0.2])
    raised = random.uniform(0.0, 0.7)
    parts = [
        Part("chest", (0, 0, 2 * leg + 0.75 * h), (w / 2, d / 2, 0.3 * h)),
        Part("hips", (0, 0, 2 * leg + 0.2 * h), (0.4 * w, 0.4 * d, 0.17 * h)),
        Part("head", (0, 0.05, 2 * leg + 1.2 * h + neck), (0.24, 0.22, 0.22), 0.5),
        Part("neck", (0, 0, 2 * leg + 1.05 * h + neck / 2), (0.08, 0.08, neck / 2 + 0.05), 0.6),
        Part("pack", (0, -0.6 * d, 2 * leg + 0.75 * h), (0.3 * w, 0.15 * d, 0.25 * h)),
        Part("dial", (0, 0.52 * d, 2 * leg + 0.85 * h), (0.12, 0.04, 0.12), 0.9),
    ]
    for x in (-1, 1):
        shoulder = np.array((x * (w / 2 + 0.12), 0, 2 * leg + 0.95 * h))
        down = rotation((0, -x * raised, 0)) @ (0, 0, -1.0)
        turn = (0.0, -x * raised, 0.0)
        for name, at, half, e in (
            ("shoulder", 0.0, (0.13, 0.13, 0.13), 1.0),
            ("upper arm", 0.5 * arm, (0.09, 0.09, 0.38 * arm), 0.4),
            ("elbow", 0.98 * arm, (0.1, 0.1, 0.1), 1.0),
            ("forearm", 1.5 * arm, (0.1, 0.1, 0.4 * arm), 0.5),
            ("hand", 2.05 * arm, (0.06, 0.13, 0.12), 0.5),
        ):
            middle = shoulder + at * down
            parts.append(Part(f"{name} {x}", tuple(middle), half, e, turn))
        for k in range(4):
            finger = shoulder + 2.35 * arm * down + (0, (k - 1.5) * 0.07, 0)
            parts.append(Part(f"finger {x} {k}", tuple(finger), (0.025, 0.025, 0.1), 0.6, turn))
        hip = x * 0.25 * w
        for name, at, half, e in (
            ("thigh", (hip, 0, 1.6 * leg), (0.13, 0.13, 0.38 * leg), 0.4),
            ("knee", (hip, 0, 1.1 * leg), (0.12, 0.12, 0.12), 1.0),
            ("shin", (hip, 0, 0.6 * leg), (0.11, 0.11, 0.42 * leg), 0.4),
            ("shoe", (hip, 0.1, 0.07), (0.14, 0.28, 0.07), 0.4),
            ("eye", (x * 0.1, 0.28, 2 * leg + 1.25 * h + neck), (0.05,) * 3, 1.0),
            ("ear", (x * 0.28, 0.05, 2 * leg + 1.25 * h + neck), (0.04, 0.08, 0.08), 0.7),
        ):
            parts.append(Part(f"{name} {x}", at, half, e))
    return parts


def plane(random: Random) -> list[Part]:
    length, span, thick, swept = random.uniform([3.5, 1.6, 0.25, 0.0], [5.0, 2.6, 0.4, 0.5])
    parts = [
        Part("hull", (0, 0, 0), (length / 2, thick, thick), 0.9),
        Part("cockpit", (0.25 * length, 0, 0.9 * thick), (0.35, 0.16, 0.18), 1.0),
        Part("fin", (-0.45 * length, 0, thick + 0.3), (0.22, 0.04, 0.4), 0.6),
        Part("nose wheel", (0.3 * length, 0, -thick - 0.25), (0.12, 0.05, 0.12), 0.9),
        Part("spinner", (0.52 * length, 0, 0), (0.12, 0.1, 0.1), 1.0),
    ]
    for y in (-1, 1):
        turn = (0.0, 0.0, -y * swept)
        wing = (0.02 * length - 0.4 * swept, y * (thick + span / 2), 0.0)
        parts.append(Part(f"wing {y}", wing, (0.35, span / 2, 0.05), 0.6, turn))
        parts.append(Part(f"flap {y}", (wing[0] - 0.45, wing[1], 0.0), (0.07, 0.3 * span, 0.03),
                          0.6, turn))  # fmt: skip
        parts.append(Part(f"tail wing {y}", (-0.45 * length, y * 0.5, 0.1), (0.18, 0.4, 0.04), 0.6))
        parts.append(Part(f"engine {y}", (0.1 * length, y * (thick + 0.45 * span), -0.2),
                          (0.4, 0.13, 0.13), 0.8))  # fmt: skip
        parts.append(Part(f"wheel {y}", (-0.05 * length, y * 0.4, -thick - 0.3),
                          (0.15, 0.06, 0.15), 0.9))  # fmt: skip
        parts.append(Part(f"blade {y}", (0.54 * length, y * 0.35, 0), (0.03, 0.28, 0.06), 0.8))
        for k in range(7):
            at = (0.22 * length - 0.35 * k, y * (thick + 0.01), 0.25 * thick)
            parts.append(Part(f"window {y} {k}", at, (0.08, 0.03, 0.08), 0.8))
    return parts


def creature(random: Random) -> list[Part]:
    length, h, fat = random.uniform([1.0, 0.8, 0.3], [1.7, 1.3, 0.5])
    head = random.uniform(0.25, 0.38)
    x0 = length / 2 + 0.8 * head
    parts = [
        Part("body", (0, 0, h), (length / 2, fat, fat), 0.9),
        Part("head", (x0, 0, h + 0.5), (head, 0.8 * head, 0.85 * head), 1.0),
        Part("muzzle", (x0 + head, 0, h + 0.42), (0.5 * head, 0.45 * head, 0.35 * head), 0.8),
        Part("nose", (x0 + 1.5 * head, 0, h + 0.5), (0.07, 0.09, 0.07), 1.0),
        Part("neck", (length / 2, 0, h + 0.28), (0.2, 0.17, 0.28), 0.8),
        Part("tongue", (x0 + 1.25 * head, 0, h + 0.28), (0.22 * head, 0.1, 0.03), 0.8),
    ]
    for k in range(5):
        at = (-length / 2 - 0.12 - 0.2 * k, 0, h + 0.1 + 0.09 * k)
        parts.append(Part(f"tail {k}", at, (0.11, 0.08 - 0.01 * k, 0.08 - 0.01 * k), 0.9))
    for y in (-1, 1):
        parts.append(Part(f"eye {y}", (x0 + 0.65 * head, y * 0.5 * head, h + 0.65),
                          (0.25 * head,) * 3, 1.0))  # fmt: skip
        parts.append(Part(f"pupil {y}", (x0 + 0.88 * head, y * 0.55 * head, h + 0.67),
                          (0.07 * head, 0.1 * head, 0.1 * head), 1.0))  # fmt: skip
        parts.append(Part(f"ear {y}", (x0 - 0.2, y * 0.55 * head, h + 0.55 + head),
                          (0.05, 0.12, 0.2), 0.8))  # fmt: skip
        for x, place in ((-0.36, "hind"), (0.36, "fore")):
            at = x * length, y * 0.8 * fat
            parts += [
                Part(f"{place} thigh {y}", (*at, 0.7 * h), (0.13, 0.11, 0.26 * h), 0.8),
                Part(f"{place} shin {y}", (*at, 0.3 * h), (0.08, 0.08, 0.24 * h), 0.8),
                Part(f"{place} paw {y}", (at[0] + 0.06, at[1], 0.04), (0.16, 0.1, 0.08), 0.8),
            ]
            for k in range(3):
                claw = (at[0] + 0.24, at[1] + (k - 1) * 0.06, 0.03)
                parts.append(Part(f"{place} claw {y} {k}", claw, (0.06, 0.02, 0.02), 1.0))
    return parts


FAMILIES: dict[str, Family] = {
    "car": car,
    "chair": chair,
    "creature": creature,
    "plane": plane,
    "robot": robot,
    "tree": tree,
}


def bent(positions: Floats, random: Random, strength: float) -> Floats:
    """Bent, twisted and tapered along the longest axis, then turned any way, moved and scaled."""
    middle = positions.mean(axis=0)
    x = positions - middle
    axes = np.argsort(-np.ptp(x, axis=0))
    x = x[:, axes] / np.ptp(x[:, axes[0]])
    x[:, 2] *= np.linalg.det(np.eye(3)[axes])  # no mirror image
    bend, twist, taper = random.uniform(-1, 1, 3) * strength * (0.8, 0.6, 0.35)
    angle = twist * x[:, 0]
    c, s = np.cos(angle), np.sin(angle)
    x = np.stack([x[:, 0], c * x[:, 1] - s * x[:, 2], s * x[:, 1] + c * x[:, 2]], axis=1)
    x[:, 1:] *= 1 + taper * x[:, :1]
    angle = bend * x[:, 0]
    if abs(bend) > 1e-9:
        radius = 1 / bend - x[:, 1]
        x = np.stack([radius * np.sin(angle), 1 / bend - radius * np.cos(angle), x[:, 2]], axis=1)
    turned: Floats = x @ rotation(random.normal(size=3) * 2.0).T
    return turned * random.uniform(0.5, 20.0) + random.normal(size=3)


def loose_pair(family: str, seed: int, left_out: float = 0.06, strength: float = 1.0) -> MadePair:
    """Two of a family. Each lacks a share of `left_out` of the parts, none of the largest."""
    random = np.random.default_rng([seed, sorted(FAMILIES).index(family)])
    directions, faces = icosphere(LEVELS)
    draws = [FAMILIES[family](random) for _ in range(2)]
    count = len(draws[0])
    positions = [
        np.concatenate([surface_of(part, directions) for part in parts]) for parts in draws
    ]
    positions[1] = bent(positions[1], random, strength)
    volume = np.array([np.prod(part.half) for part in draws[0]])
    smaller = np.flatnonzero(volume < 0.3 * volume.max())
    lacking = random.permutation(smaller)[: 2 * round(left_out * count)]
    alone = frozenset(lacking[::2].tolist()), frozenset(lacking[1::2].tolist())
    rows = np.concatenate([faces + k * len(directions) for k in range(count)])
    parts = np.repeat(np.arange(count), len(faces))
    sides = [
        Side(at, rows[~np.isin(parts, list(others))], parts[~np.isin(parts, list(others))])
        for at, others in zip(positions, (alone[1], alone[0]), strict=True)
    ]
    return MadePair(f"{family} {seed}", sides[0], sides[1], *alone)


def sampled(pair: MadePair, count: int, of_source: bool, seed: int) -> Samples:
    """Evenly at random by area."""
    here, there = (pair.source, pair.target) if of_source else (pair.target, pair.source)
    alone = pair.only_on_source if of_source else pair.only_on_target
    random = np.random.default_rng(seed)
    corners = here.positions[here.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    chosen = np.sort(random.choice(len(area), count, p=area / area.sum()))
    a, b = random.random((2, count))
    root = np.sqrt(a)
    weights = np.stack([1 - root, root * (1 - b), root * b], axis=1)[:, :, None]
    return Samples(
        positions=(corners[chosen] * weights).sum(axis=1),
        normals=cross[chosen] / np.maximum(area[chosen], 1e-300)[:, None],
        parts=here.parts[chosen],
        truth=(there.positions[here.faces[chosen]] * weights).sum(axis=1),
        is_shared=~np.isin(here.parts[chosen], list(alone)),
    )
