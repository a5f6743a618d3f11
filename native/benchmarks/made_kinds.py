"""Kinds of figures made by script that the method wasn't made for, from ants to birds.

As in `made_figures`, each is drawn from a build and a pose, and is a body of one piece (see
`made_bodies`). Two of a kind differ in both. Beside them, beasts and people of unlike builds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from made_bodies import Body, Family, body_pair, rotation_vector
from made_figures import DOWN, Limb, any_build, person, unlike, unlike_beast
from made_shapes import Part, Random, rotation

AHEAD = rotation((0, np.pi / 2, 0))
"""Turns limbs, which grow along their z axis, to grow along x, their own x axis down."""
BEHIND = rotation((np.pi / 2, 0, 0))
"""The same against y, their x axis as it was."""
REACHES = (0.9, 0.9, 1.2)
"""Of an ant's legs, from the fore to the hind ones, as shares of what is drawn."""
DEPTHS = (1.0, 1.08, 0.95, 0.75, 0.5, 0.3)
"""Of pieces of a fish from head to tail, as shares of what is drawn."""
RIM_PIECES, TEMPLE_PIECES, HANDLE_PIECES, TAIL_JOINTS = 12, 3, 4, 6
SNAKE_JOINTS = 16
SNAKE_WAVE = 0.7
"""Radians of a wave from one joint to the next: nine joints are a whole one."""


def held(by: Limb, part: Part) -> Part:
    """A part whose middle and turn are in the frame of a limb's end, where it is in space."""
    middle = by.at + by.turn @ part.middle
    return replace(part, middle=tuple(middle),
                   turn=rotation_vector(by.turn @ rotation(part.turn)))  # fmt: skip


def ant(build: Random, pose: Random) -> list[Part]:
    """A thorax with six legs of three parts, an abdomen on a waist, a head with bent antennae."""
    thorax, abdomen, size = build.uniform([0.22, 0.35, 0.2], [0.35, 0.6, 0.3])
    fat, reach, thin = (
        build.uniform(low, high) for low, high in ((0.22, 0.4), (0.5, 0.9), (0.035, 0.05))
    )
    parts = [
        Part("thorax", (0, 0, 0), (thorax, 0.16, 0.15), 0.9),
        Part("abdomen", (-thorax - 0.8 * abdomen, 0, 0.05), (abdomen, fat, 0.9 * fat), 1.0,
             (0, pose.uniform(-0.3, 0.3), 0)),
        Part("waist", (-thorax, 0, 0), (0.15, 0.06, 0.06), 0.9),
    ]  # fmt: skip
    limb = Limb("neck", np.array((0.8 * thorax, 0, 0.02)),
                rotation((0, np.pi / 2 + pose.uniform(-0.3, 0.4), 0)))  # fmt: skip
    parts.append(limb.grow(0.12, 0.08, (0, 0, 0)))
    head = Limb("head", limb.at + limb.turn @ (0, 0, 0.8 * size), limb.turn)
    parts.append(held(head, Part("head", (0, 0, 0), (0.7 * size, 0.8 * size, size), 1.0)))
    for y in (-1, 1):
        at = head.at + head.turn @ (-0.3 * size, 0.35 * y * size, 0.8 * size)
        limb = Limb(f"antenna {y}", at, head.turn @ rotation((-0.7 * y, -0.5, 0)))
        parts.append(limb.grow(0.3, 0.03, (0, 0, 0)))
        parts.append(limb.grow(0.3, 0.03, (pose.uniform(-0.3, 0.3), pose.uniform(0.3, 1.1), 0)))
        for x, share in zip((1, 0, -1), REACHES, strict=True):
            at = np.array((0.56 * x * thorax, 0.12 * y, -0.05))
            parts += ant_leg(Limb(f"leg {x} {y}", at, np.eye(3)), share * reach, thin, pose)
    return parts


def ant_leg(limb: Limb, reach: float, thin: float, pose: Random) -> list[Part]:
    """Outward and up, down from the knee, and a foot."""
    x, y = (int(word) for word in limb.name.split()[1:])
    around = y * (np.pi / 2 - 0.6 * x) + pose.uniform(-0.2, 0.2)
    upward = 0.5 + pose.uniform(-0.2, 0.2)
    limb.turn = rotation((0, 0, around)) @ rotation((0, np.pi / 2 - upward, 0))
    return [
        limb.grow(0.35 * reach, 1.4 * thin, (0, 0, 0)),
        limb.grow(0.6 * reach, thin, (0, 1.3 + pose.uniform(-0.25, 0.25), 0)),
        limb.grow(0.35 * reach, thin, (0, -0.5 + pose.uniform(-0.2, 0.2), 0)),
    ]


def fish(build: Random, pose: Random) -> list[Part]:
    """A body bent to a side, higher than broad, with a forked tail and fins."""
    length, fat, tall = build.uniform([1.0, 0.12, 0.22], [1.6, 0.22, 0.42])
    tail, fin = build.uniform([0.25, 0.15], [0.5, 0.4])
    bend, curl = pose.uniform(-0.25, 0.25), pose.uniform(-0.2, 0.2)
    step = length / len(DEPTHS)
    at, turn = np.zeros(3), AHEAD
    parts, joints = [], []
    for k, depth in enumerate(DEPTHS):
        turn = rotation((0, 0, bend + curl * (k - 2) if k else 0.0)) @ turn
        joints.append(Limb("body", at, turn))
        half = (tall * depth, fat * depth, 0.95 * step)
        parts.append(held(joints[-1], Part("body", (0, 0, step / 2), half, 0.9)))
        at = at + turn @ (0, 0, step)
    end = Limb("tail", at, turn)
    up, down = (0.55 * tail, 0.05, 0.28 * tail), (0.45 * tail, 0.05, 0.26 * tail)
    back, belly = (0.5 * fin + 0.05, 0.03, 0.28), (0.35 * fin + 0.05, 0.03, 0.15)
    parts += [
        held(end, Part("tail up", (-0.4 * tail, 0, 0.15 * tail), up, 0.9, (0, -0.6, 0))),
        held(end, Part("tail down", (0.3 * tail, 0, 0.15 * tail), down, 0.9, (0, 0.6, 0))),
        held(joints[2], Part("back fin", (-tall * DEPTHS[2] - 0.3 * fin, 0, 0), back, 0.8)),
        held(joints[3], Part("belly fin", (tall * DEPTHS[3] + 0.1 * fin, 0, 0.05), belly, 0.8)),
    ]
    for y in (-1, 1):
        place, half = (0.35 * tall, y * (fat + 0.3 * fin), 0.1), (0.1, 0.5 * fin + 0.04, 0.03)
        lean = (y * pose.uniform(-0.1, 0.5), 0, 0)
        parts.append(held(joints[1], Part(f"side fin {y}", place, half, 0.8, lean)))
    mouth = (0.35 * tall, 0.6 * fat, 0.2)
    parts.append(held(joints[0], Part("mouth", (0.15 * tall, 0, -0.12), mouth, 0.9)))
    return parts


def teddy(build: Random, pose: Random) -> list[Part]:
    """A fat body, arms and legs without joints, a large head with a muzzle and round ears."""
    fat, tall, size = build.uniform([0.35, 0.45, 0.3], [0.5, 0.6, 0.42])
    arm, leg = build.uniform([0.3, 0.3], [0.45, 0.45])
    nod, shake = pose.uniform(-0.2, 0.2), pose.uniform(-0.4, 0.4)
    head = Limb("head", np.array((0, 0, tall + 0.8 * size)), rotation((nod, 0, shake)))
    muzzle, ear = (0.4 * size, 0.35 * size, 0.3 * size), (0.32 * size, 0.14 * size, 0.32 * size)
    parts = [
        Part("body", (0, 0, 0), (fat, 0.85 * fat, tall), 1.0),
        held(head, Part("head", (0, 0, 0), (size, 0.9 * size, 0.9 * size), 1.0)),
        held(head, Part("muzzle", (0, 0.85 * size, -0.15 * size), muzzle, 1.0)),
    ]
    for x in (-1, 1):
        parts.append(held(head, Part(f"ear {x}", (0.75 * x * size, 0, 0.75 * size), ear, 1.0)))
        forward, aside = pose.uniform(-0.3, 0.9), pose.uniform(1.2, 2.2)
        limb = Limb(f"arm {x}", np.array((0.7 * x * fat, 0, 0.65 * tall)),
                    rotation((-forward, 0, 0)) @ rotation((0, x * aside, 0)))  # fmt: skip
        parts.append(limb.grow(arm + 0.15, 0.14, (0, 0, 0)))
        forward, aside = pose.uniform(0.0, 1.2), pose.uniform(0.1, 0.4)
        limb = Limb(f"leg {x}", np.array((0.55 * x * fat, 0, -0.7 * tall)),
                    rotation((forward, 0, 0)) @ DOWN @ rotation((0, x * aside, 0)))  # fmt: skip
        parts.append(limb.grow(leg + 0.2, 0.17, (0, 0, 0)))
    return parts


def glasses(build: Random, pose: Random) -> list[Part]:
    """Rims without panes, a bridge, temples that are folded a little and bent behind the ears."""
    wide, high, gap, reach = build.uniform([0.5, 0.38, 0.12, 1.1], [0.7, 0.55, 0.25, 1.6])
    thin = build.uniform(0.035, 0.05)
    parts = []
    for x in (-1, 1):
        middle = np.array((x * (wide + gap / 2 + 0.02), 0, 0))
        for k in range(RIM_PIECES):
            angle = 2 * np.pi * (k + 0.5) / RIM_PIECES
            at = middle + np.array((wide * np.cos(angle), 0, high * np.sin(angle)))
            along = np.array((-wide * np.sin(angle), 0, high * np.cos(angle)))
            # Half of its share of the rim would just meet the next piece: it reaches into that.
            share = 2 * np.pi * float(np.linalg.norm(along)) / RIM_PIECES
            half = (thin, thin, 0.62 * share)
            turn = (0, np.arctan2(along[0], along[2]), 0)
            parts.append(Part(f"rim {x}", tuple(at), half, 0.8, turn))
        fold = pose.uniform(-0.1, 0.7)
        limb = Limb(f"temple {x}", np.array((x * (2 * wide + gap / 2), 0, 0.1)),
                    rotation((0, 0, -x * fold)) @ BEHIND)  # fmt: skip
        for _ in range(TEMPLE_PIECES):
            parts.append(limb.grow(0.27 * reach, thin, (0, 0, 0)))
        parts.append(limb.grow(0.22 * reach, thin, (0.6, 0, 0)))
    parts.append(Part("bridge", (0, 0, 0.1), (gap / 2 + 0.06, thin, thin), 0.8))
    return parts


def pliers(build: Random, pose: Random) -> list[Part]:
    """Two bent handles that cross at a pivot with a screw, each with a jaw."""
    jaw, handle, thick = build.uniform([0.35, 0.9, 0.07], [0.55, 1.4, 0.1])
    curve, opened = build.uniform(0.1, 0.3), pose.uniform(0.05, 0.5)
    parts = [Part("pivot", (0, 0, 0), (0.14, 0.13, 0.14), 0.8)]
    for side in (-1, 1):
        # Bowed outward, so that they come no nearer to each other than at the pivot.
        spread = opened / 2 + 0.12 + 0.75 * curve
        limb = Limb(f"handle {side}", np.array((0, 0.03 * side, 0)),
                    DOWN @ rotation((0, side * spread, 0)))  # fmt: skip
        for k in range(HANDLE_PIECES):
            parts.append(
                limb.grow(handle / HANDLE_PIECES, thick, (0, -side * curve / 2 if k else 0.0, 0))
            )
        # Across from its handle, and next to the other jaw where the pliers are shut.
        limb = Limb(f"jaw {side}", np.array((-1.3 * side * thick, 0.03 * side, 0)),
                    rotation((0, -side * opened / 2, 0)))  # fmt: skip
        parts.append(limb.grow(0.6 * jaw, 1.4 * thick, (0, 0, 0)))
        parts.append(limb.grow(0.5 * jaw, 0.9 * thick, (0, 0.12 * side, 0)))
    parts.append(Part("screw", (0, 0.16, 0), (0.06, 0.08, 0.06), 0.8))
    return parts


def snake(build: Random, pose: Random) -> list[Part]:
    """One thin body that winds; but for a jaw and eyes, nothing tells its back from its belly."""
    length, thick = build.uniform([3.5, 0.09], [5.0, 0.15])
    winding, coil, begin = pose.uniform(0.2, 0.5), pose.uniform(-0.12, 0.12), pose.uniform(0, 6)
    limb = Limb("body", np.zeros(3), np.eye(3))
    parts = []
    for k in range(SNAKE_JOINTS):
        along = (k + 0.5) / SNAKE_JOINTS
        # The tail, a third of it, is thinner.
        radius = thick * (1.0 if along > 0.35 else 0.45 + 1.55 * along)
        bend = (coil, winding * np.sin(SNAKE_WAVE * k + begin), 0)
        parts.append(limb.grow(length / SNAKE_JOINTS, radius, bend))
    head, jaw = (1.6 * thick, 1.1 * thick, 2.2 * thick), (thick, 0.5 * thick, 1.6 * thick)
    parts.append(held(limb, Part("head", (0, 0, 1.3 * thick), head, 0.9)))
    parts.append(held(limb, Part("jaw", (0, 0.6 * thick, 2.2 * thick), jaw, 0.9)))
    for x in (-1, 1):
        at, ball = (1.1 * x * thick, -0.8 * thick, 1.6 * thick), (0.4 * thick,) * 3
        parts.append(held(limb, Part(f"eye {x}", at, ball, 1.0)))
    return parts


def dinosaur(build: Random, pose: Random) -> list[Part]:
    """On two legs: a large head with a jaw on a short neck, small arms, a tail that thins."""
    length, fat, leg, tail, size = build.uniform([0.5, 0.26, 0.45, 1.0, 0.28],
                                                 [0.8, 0.38, 0.65, 1.5, 0.42])  # fmt: skip
    arm, tilt = build.uniform(0.15, 0.3), pose.uniform(-0.5, 0.1)
    trunk = rotation((0, tilt, 0))
    parts = [Part("body", (0, 0, 0), (length, 0.8 * fat, fat), 0.9, (0, tilt, 0))]
    limb = Limb("neck", trunk @ (0.8 * length, 0, 0.3 * fat), rotation((0, 0.4, 0)))
    parts.append(limb.grow(0.25, 0.15, (0, pose.uniform(-0.3, 0.3), 0)))
    parts.append(limb.grow(0.2, 0.13, (pose.uniform(-0.2, 0.2), pose.uniform(-0.2, 0.4), 0)))
    head = Limb("head", limb.at, limb.turn @ rotation((0, 1.1, 0)))
    jaw = Part("jaw", (0.17, 0, 0.6 * size), (0.06, 0.11, 0.8 * size), 0.8, (0, 0.25, 0))
    parts.append(held(head, Part("head", (0, 0, 0.6 * size), (0.16, 0.14, size), 0.9)))
    parts.append(held(head, jaw))
    limb = Limb("tail", trunk @ (-0.8 * length, 0, 0.05),
                rotation((0, -np.pi / 2 + 0.5 * tilt, 0)))  # fmt: skip
    for k in range(TAIL_JOINTS):
        bend = (pose.uniform(-0.25, 0.25), pose.uniform(-0.2, 0.2), 0)
        parts.append(limb.grow(tail / TAIL_JOINTS, 0.2 * (1 - k / (TAIL_JOINTS + 1)), bend))
    for y in (-1, 1):
        limb = Limb(f"arm {y}", trunk @ (0.65 * length, 0.65 * y * fat, -0.35 * fat),
                    DOWN @ rotation((0, pose.uniform(-0.6, 0.3), 0)))  # fmt: skip
        parts.append(limb.grow(arm, 0.05, (0, 0, 0)))
        parts.append(limb.grow(0.9 * arm, 0.045, (0, -pose.uniform(0.3, 1.2), 0)))
        limb = Limb(f"leg {y}", np.array((-0.1, 0.6 * y * fat, -0.3 * fat)),
                    DOWN @ rotation((0, pose.uniform(-0.5, 0.7), 0)))  # fmt: skip
        parts.append(limb.grow(leg, 0.14, (0, 0, 0)))
        parts.append(limb.grow(0.9 * leg, 0.08, (0, pose.uniform(0.2, 0.9), 0)))
        parts.append(limb.grow(0.28, 0.07, (0, -1.4, 0)))
    return parts


def bird(build: Random, pose: Random) -> list[Part]:
    """Wings of two parts that are spread, raised or half folded, both alike but for the tips."""
    length, fat, span, neck, tail = build.uniform([0.5, 0.22, 0.8, 0.2, 0.35],
                                                  [0.75, 0.36, 1.3, 0.6, 0.7])  # fmt: skip
    parts = [Part("body", (0, 0, 0), (length, fat, fat), 1.0)]
    limb = Limb("neck", np.array((0.85 * length, 0, 0.1)), rotation((0, 0.6, 0)))
    for _ in range(2):
        parts.append(limb.grow(neck / 2, 0.1, (0, pose.uniform(-0.5, 0.5), 0)))
    head = Limb("head", limb.at, limb.turn @ rotation((0, 0.5, 0)))
    parts += [
        held(head, Part("head", (0, 0, 0.08), (0.14, 0.12, 0.16), 1.0)),
        held(head, Part("beak", (0, 0, 0.3), (0.05, 0.05, 0.16), 1.0)),
        Part("tail", (-length - 0.4 * tail, 0, 0.02), (0.55 * tail, 0.18, 0.035), 0.8,
             (0, pose.uniform(-0.3, 0.3), 0)),
    ]  # fmt: skip
    lift, sweep = pose.uniform(-0.5, 0.9), pose.uniform(-0.3, 0.6)
    for y in (-1, 1):
        wing = Limb(f"wing {y}", np.array((0.15, 0.7 * y * fat, 0.3 * fat)),
                    rotation((y * lift, 0, 0)) @ rotation((0, 0, y * sweep / 2)))  # fmt: skip
        half = (0.25, 0.3 * span + 0.06, 0.045)
        parts.append(held(wing, Part(wing.name, (0, 0.25 * y * span, 0), half, 0.8)))
        fold = rotation((y * pose.uniform(-0.5, 0.3), 0, 0)) @ rotation((0, 0, y * sweep))
        wing.at, wing.turn = wing.at + wing.turn @ (0, 0.5 * y * span, 0), wing.turn @ fold
        half = (0.18, 0.36 * span, 0.04)
        parts.append(held(wing, Part(wing.name, (0, 0.3 * y * span, 0), half, 0.9)))
        limb = Limb(f"leg {y}", np.array((-0.1, 0.4 * y * fat, -0.75 * fat)),
                    DOWN @ rotation((0, pose.uniform(-0.6, 0.6), 0)))  # fmt: skip
        parts.append(limb.grow(0.25, 0.05, (0, 0, 0)))
        foot = limb.at + np.array((0.05, 0, 0))
        parts.append(Part(f"foot {y}", tuple(foot), (0.12, 0.07, 0.035), 0.8))
    return parts


KINDS: dict[str, Family] = {
    "ants": any_build(ant),
    "fish": any_build(fish),
    "teddies": any_build(teddy),
    "glasses": any_build(glasses),
    "pliers": any_build(pliers),
    "snakes": any_build(snake),
    "dinosaurs": any_build(dinosaur),
    "birds": any_build(bird),
    "unlike-beasts": any_build(unlike_beast),
    "unlike-people": unlike(person),
}


def kind_pair(kind: str, seed: int, points: int, strength: float = 0.3) -> tuple[Body, Body]:
    """Two builds in two poses, the second one bent and twisted a little, turned any way."""
    return body_pair(KINDS[kind], seed, points, strength)
