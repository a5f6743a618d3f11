"""Clouds and settings of every kind, as Hypothesis draws them: awkward ones more often than not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pointmorph
from hypothesis import strategies as st
from shapes import ball, grid, grid_faces

Array = np.ndarray

KINDS = (
    *("sheet", "ball", "rod", "disc", "torn", "needles", "uneven", "clump", "line", "few", "loose"),
    *("noise", "lattice", "layers", "speck"),
)
SCALES = (1e-30, 1e-12, 1e-4, 1.0, 37.5, 1e5, 1e12, 1e30)


@dataclass(frozen=True)
class Case:
    """What a morph is made of."""

    source: pointmorph.Cloud
    target: pointmorph.Cloud
    features: dict[str, pointmorph.Feature | tuple[int, int]]
    settings: dict[str, Any]

    def morph(self, **more: Any) -> pointmorph.Morph:
        return pointmorph.morph(
            self.source, self.target, self.features, **{**self.settings, **more}
        )


def points(kind: str, count: int, random: np.random.Generator) -> Array:
    """At least two points of about unit size."""
    side = max(int(count**0.5), 4)
    if kind == "sheet":
        return grid(side, 0.6, np.float64)
    if kind == "ball":
        return ball(count) * [1.0, 0.7, 0.5]
    if kind == "rod":
        return ball(count) * [1.0, 0.02, 0.02]
    if kind == "disc":
        return ball(count) * [1.0, 1.0, 1e-7]
    if kind == "torn":
        sheet = grid(side, 0.2, np.float64)
        return sheet + np.where(sheet[:, :1] > 0, [[0.5, 0, 3.0]], 0.0)
    if kind == "needles":  # one of them leaves a ball far behind
        tips = np.linspace(1, 40, max(count // 10, 3))[:, None] * [0, 0, 1.0]
        return np.concatenate([ball(count), tips])
    if kind == "uneven":  # 10,000 times as dense on one side
        return ball(count) * 10.0 ** np.linspace(-4, 0, count)[:, None]
    if kind == "clump":  # most of them in one place
        rows = ball(count)
        rows[count // 3 :] = rows[0]
        return rows
    if kind == "line":
        return np.linspace(0, 1, count)[:, None] * [1.0, 2.0, -1.0]
    if kind == "few":
        return ball(int(random.integers(2, 20)))
    if kind == "loose":
        return np.concatenate([ball(count // 3) + np.array([2.5 * k, 0, 0]) for k in range(3)])
    if kind == "noise":
        return random.normal(size=(count, 3))
    if kind == "lattice":  # all distances alike
        steps = np.arange(max(round(count ** (1 / 3)), 3), dtype=float)
        return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    if kind == "layers":  # sheets closer to each other than their points
        sheet = grid(side, 0.0, np.float64)
        return np.concatenate([sheet, sheet + np.array([0, 0, 1e-3])])
    return np.repeat(random.normal(size=(1, 3)), count, axis=0)


@st.composite
def clouds(draw: st.DrawFn, name: str, most: int) -> pointmorph.Cloud:
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(KINDS))
    rows = points(kind, draw(st.integers(12, most)), random)
    rows = rows @ np.linalg.qr(random.normal(size=(3, 3)))[0]
    scale = draw(st.sampled_from(SCALES))
    rows = scale * (rows + draw(st.sampled_from([0.0, 0.0, 3.0, 1e4])))
    if draw(st.booleans()):
        rows = random.permutation(rows)
        kind = ""
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    count = len(rows)
    given: dict[str, Any] = {}
    if draw(st.booleans()):
        normals = random.normal(size=(count, 3))
        given["normals"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if draw(st.booleans()):
        given["colors"] = random.random((count, 4))
    if draw(st.booleans()):
        given["radii"] = scale * random.random(count)
    if kind == "sheet" and draw(st.booleans()):
        given["faces"] = grid_faces(int(count**0.5))
    return pointmorph.Cloud(rows.astype(dtype), name=name, **given)


def _values(option: pointmorph.Option) -> st.SearchStrategy[Any]:
    if option.kind == "choice":
        return st.sampled_from(option.choices)
    if option.name == "threads":
        return st.integers(0, 3)
    if option.kind == "int":  # sweeps and nodes without end take time, and no other way
        return st.integers(int(option.minimum), int(min(option.maximum, 3000)))
    return st.floats(option.minimum, min(option.maximum, 1e6))


@st.composite
def cases(draw: st.DrawFn, most: int = 60) -> Case:
    source, target = draw(clouds("A", most)), draw(clouds("B", most))
    table = {option.name: option for option in pointmorph.options()}
    names = draw(st.lists(st.sampled_from(sorted(table)), max_size=4, unique=True))
    settings = {name: draw(_values(table[name])) for name in names}
    settings["method"] = draw(st.sampled_from(["auto", "auto", "paper"]))
    features: dict[str, pointmorph.Feature | tuple[int, int]] = {}
    for number in range(draw(st.integers(0, 3))):
        rows = [draw(st.integers(0, len(cloud) - 1)) for cloud in (source, target)]
        features[f"mark {number}"] = rows[0], rows[1]
    return Case(source, target, features, settings)
