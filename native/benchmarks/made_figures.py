"""Figures made by script that are bent at their joints, with thin limbs: beasts, people and hands.

A build is drawn once, and a pose twice: both figures of a pair are of the same parts, which are
only turned, so that they are nearly isometric. They are bodies of one piece (see `made_bodies`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from made_bodies import Body, Family, body_pair, rotation_vector
from made_shapes import Floats, Ints, Part, Random, rotation

DOWN = rotation((np.pi, 0, 0))
"""Turns limbs, which grow along their z axis, to hang."""


@dataclass
class Limb:
    """Grows along its own z axis, joint by joint."""

    name: str
    at: Floats
    turn: Floats

    def grow(self, length: float, radius: float, bend: tuple[float, float, float]) -> Part:
        """One more part, bent by a rotation vector in the frame of the last one."""
        self.turn = self.turn @ rotation(bend)
        middle = self.at + self.turn @ (0, 0, length / 2)
        # Reaches into the last part and the next one.
        half = (radius, radius, length / 2 + 0.8 * radius)
        self.at = self.at + self.turn @ (0, 0, length)
        return Part(self.name, tuple(middle), half, 0.6, rotation_vector(self.turn))


@dataclass(frozen=True)
class BeastRange:
    """Least and most of the lengths of beasts."""

    trunk: tuple[list[float], list[float]]
    """Its length, half its height, and half the length of a leg."""
    ends: tuple[list[float], list[float]]
    """Length and radius of the tail, and length of the neck."""
    aside: float = 0.0
    """How far from the middle legs stand at least."""


BEASTS = BeastRange(([1.2, 0.26, 0.4], [1.6, 0.36, 0.55]), ([0.6, 0.03, 0.3], [0.9, 0.04, 0.6]))
UNLIKE_BEASTS = BeastRange(([1.0, 0.2, 0.22], [1.6, 0.45, 0.85]),
                           ([0.2, 0.03, 0.15], [1.2, 0.06, 1.1]), 0.19)  # fmt: skip


def beast(build: Random, pose: Random) -> list[Part]:
    """Four legs, a neck, a head with ears, and a thin tail."""
    return beast_in(BEASTS, build, pose)


def unlike_beast(build: Random, pose: Random) -> list[Part]:
    """Builds as far apart as those of a pig and a giraffe, with legs spread."""
    return beast_in(UNLIKE_BEASTS, build, pose)


def beast_in(ranges: BeastRange, build: Random, pose: Random) -> list[Part]:
    length, fat, leg = build.uniform(*ranges.trunk)
    tail, thin, neck = build.uniform(*ranges.ends)
    parts = [Part("body", (0, 0, 0), (length / 2, 0.8 * fat, fat), 0.8)]
    limb = Limb("neck", np.array((0.42 * length, 0, 0.4 * fat)), rotation((0, 0.7, 0)))
    for _ in range(2):
        parts.append(limb.grow(neck / 2, 0.13, (0, pose.uniform(-0.35, 0.25), 0)))
    turn = limb.turn @ rotation((pose.uniform(-0.3, 0.3), 0.9, 0))
    head = limb.at + turn @ (0, 0, 0.12)
    parts.append(Part("head", tuple(head), (0.13, 0.12, 0.26), 0.9, rotation_vector(turn)))
    for y in (-1, 1):
        at = head + turn @ (-0.1, 0.09 * y, -0.14)
        ear = turn @ rotation((-0.4 * y, -1.7, 0))
        parts.append(Part(f"ear {y}", tuple(at + ear @ (0, 0, 0.08)), (0.03, 0.05, 0.14), 0.8,
                          rotation_vector(ear)))  # fmt: skip
        for x in (-1, 1):
            aside = max(0.5 * fat, ranges.aside)
            at = np.array((0.38 * x * length, y * aside, -0.45 * fat))
            limb = Limb(f"leg {x} {y}", at, DOWN)
            knee = -x * pose.uniform(0.0, 0.6)
            for share, thick, bend in (
                (0.55, 0.11, (0.0, pose.uniform(-0.5, 0.5), 0.0)),
                (0.5, 0.075, (0.0, knee, 0.0)),
                (0.12, 0.08, (0.0, -0.8 * knee, 0.0)),
            ):
                parts.append(limb.grow(share * 2 * leg, thick, bend))
    limb = Limb("tail", np.array((-0.47 * length, 0, 0.3 * fat)),
                rotation((0, -1.9 - pose.uniform(0.0, 0.6), 0)))  # fmt: skip
    for _ in range(5):
        bend = (pose.uniform(-0.25, 0.25), pose.uniform(-0.3, 0.2), 0)
        parts.append(limb.grow(tail / 5, thin, bend))
    return parts


def fingers(parts: list[Part], palm: Limb, size: float, side: int, pose: Random) -> None:
    """Four close to each other, and a thumb, at the end of a palm that is flat along x."""
    curl = pose.uniform(0.0, 0.5)
    for k, length in enumerate((0.75, 0.95, 1.0, 0.85)):
        at = palm.at + palm.turn @ ((k - 1.5) * 0.25 * size * side, 0, -0.05 * size)
        turn = rotation((0, (k - 1.5) * pose.uniform(0, 0.1) * side, 0))
        limb = Limb(f"{palm.name} finger {k}", at, palm.turn @ turn)
        for _ in range(3):
            parts.append(limb.grow(length * size / 3, 0.115 * size, (curl, 0, 0)))
    at = palm.at + palm.turn @ (-0.5 * size * side, 0, -0.7 * size)
    limb = Limb(f"{palm.name} thumb", at, palm.turn @ rotation((0, -0.8 * side, 0)))
    for _ in range(2):
        parts.append(limb.grow(0.4 * size, 0.14 * size, (0.3 * curl, 0.3 * side, 0)))


def palm(at: Limb, size: float) -> Part:
    middle = at.at + at.turn @ (0, 0, size / 2)
    at.at = at.at + at.turn @ (0, 0, size)
    half = (0.5 * size, 0.17 * size, 0.58 * size)
    return Part(at.name, tuple(middle), half, 0.6, rotation_vector(at.turn))


def person(build: Random, pose: Random) -> list[Part]:
    """Arms and legs bent at their joints, and hands with fingers."""
    tall, broad, size = build.uniform([0.5, 0.17, 0.15], [0.62, 0.24, 0.19])
    parts = [
        Part("chest", (0, 0, 0.75 * tall), (broad, 0.6 * broad, 0.42 * tall), 0.7),
        Part("hips", (0, 0, 0.25 * tall), (0.9 * broad, 0.6 * broad, 0.27 * tall), 0.7),
    ]
    limb = Limb("head", np.array((0, 0, 1.1 * tall)), np.eye(3))
    parts.append(limb.grow(0.15, 0.07, (pose.uniform(-0.2, 0.3), 0, 0)))
    turn = rotation_vector(limb.turn)
    parts.append(
        Part("head", tuple(limb.at + np.array((0, 0.02, 0.08))), (0.095, 0.115, 0.14), 0.9, turn)
    )
    parts.append(
        Part("nose", tuple(limb.at + np.array((0, 0.14, 0.06))), (0.02, 0.03, 0.03), 1.0, turn)
    )
    for x in (-1, 1):
        limb = Limb(f"arm {x}", np.array((x * broad * 0.95, 0, 1.02 * tall)),
                    rotation((0, x * pose.uniform(1.3, 2.5), 0)))  # fmt: skip
        parts.append(limb.grow(0.3, 0.06, (0, 0, 0)))
        parts.append(limb.grow(0.27, 0.05, (-pose.uniform(0.0, 0.9), 0, 0)))
        hand = Limb(f"hand {x}", limb.at, limb.turn)
        parts.append(palm(hand, size))
        fingers(parts, hand, size, x, pose)
        limb = Limb(f"leg {x}", np.array((x * broad * 0.5, 0, 0.1 * tall)),
                    DOWN @ rotation((0, x * pose.uniform(0.05, 0.35), 0)))  # fmt: skip
        parts.append(limb.grow(0.45, 0.095, (pose.uniform(-0.3, 0.6), 0, 0)))
        parts.append(limb.grow(0.45, 0.07, (-pose.uniform(0.0, 0.7), 0, 0)))
        foot = limb.at + np.array((0, 0.07, 0))
        parts.append(Part(f"foot {x}", tuple(foot), (0.06, 0.14, 0.05), 0.7))
    return parts


def hand(build: Random, pose: Random) -> list[Part]:
    """A forearm's end, a palm, and fingers that nearly touch."""
    size = build.uniform(0.9, 1.1)
    limb = Limb("arm", np.array((0, 0, -0.6)), np.eye(3))
    parts = [limb.grow(0.7, 0.26, (0, 0, 0))]
    at = Limb("palm", limb.at, rotation((pose.uniform(-0.4, 0.4), 0, 0)))
    parts.append(palm(at, size))
    fingers(parts, at, size, 1, pose)
    return parts


@dataclass
class Wider:
    """In place of a draw: as many times as far from the middle of each range."""

    random: Random
    factor: float

    def uniform(self, low: float | list[float], high: float | list[float]) -> Any:
        middle = (np.asarray(low) + high) / 2
        reach = self.factor * (np.asarray(high) - low) / 2
        return self.random.uniform(middle - reach, middle + reach)


Figure = Callable[[Random, Random], list[Part]]


def unlike(figure: Figure) -> Family:
    """Draws builds that differ twice as much, in poses that differ 1.3 times as much."""
    return lambda random: figure(cast(Random, Wider(random, 2.0)), cast(Random, Wider(random, 1.3)))


def any_build(figure: Figure) -> Family:
    """Draws a build with each pose."""
    return lambda random: figure(random, random)


FIGURES: dict[str, Figure] = {"beasts": beast, "people": person, "hands": hand}
THIN = ("tail", "finger", "thumb", "ear")
"""Words in the names of thin parts."""


def of_build(figure: Figure, seed: int) -> Family:
    """Draws poses of one build."""
    return lambda pose: figure(np.random.default_rng(seed), pose)


def figure_pair(figure: Figure, seed: int, points: int) -> tuple[Body, Body]:
    """Two poses of one build, the second one turned any way."""
    return body_pair(of_build(figure, 100 + seed), seed, points, strength=0.0)


class Middle:
    """In place of a draw: the middle of each range, which bends nothing to a side."""

    def uniform(self, low: float, high: float) -> float:
        return (low + high) / 2


ACROSS = {"beasts": 1, "people": 0}
"""Figures that are alike on both sides in that pose, and the axis across."""


def symmetric_pair(kind: str, seed: int, points: int) -> tuple[Body, Body]:
    """Two builds of a figure in the middle pose, the second one turned any way."""
    builds = iter(np.random.default_rng((seed, k)) for k in range(2))

    def family(_: Random) -> list[Part]:
        return FIGURES[kind](next(builds), cast(Random, Middle()))

    return body_pair(family, seed, points, strength=0.0)


def limb_numbers(figure: Figure, seed: int) -> tuple[list[str], Ints]:
    """Names of the limbs, and of each part the number of its limb."""
    names = [part.name for part in figure(np.random.default_rng(100 + seed),
                                          np.random.default_rng(0))]  # fmt: skip
    limbs = sorted(set(names))
    return limbs, np.array([limbs.index(name) for name in names])
