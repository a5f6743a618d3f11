"""Networks of curves on closed shapes with handles."""

import json
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from pointmorph.commands import cli
from shapes import CUBE, SQUARES, around_torus, torus

SOURCE, TARGET = (pointmorph.Cloud(torus(*size)) for size in ((0.4, 60, 24), (0.3, 54, 21)))
ROWS = around_torus(60, 24), around_torus(54, 21)
FEATURES = {name: (ROWS[0][name], ROWS[1][name]) for name in ROWS[0]}


def test_patches_are_the_same_on_both_and_curves_join_their_features() -> None:
    network = pointmorph.trace_network(SOURCE, TARGET, FEATURES)
    assert len(FEATURES) - len(network.curves) + len(network.patches) == 0
    for curve in network.curves:
        for points, cloud, side in ((curve.source, SOURCE, 0), (curve.target, TARGET, 1)):
            ends = cloud.positions[[FEATURES[curve.start][side], FEATURES[curve.end][side]]]
            assert np.allclose(points[[0, -1]], ends, atol=1e-9)
    for labels in (network.source, network.target):
        assert set(labels) == {-1, *range(len(network.patches))}
        assert (labels < 0).sum() == len(FEATURES)
    assert all(len(set(patch)) >= 3 for patch in network.patches)


def test_loops_are_the_first_curves() -> None:
    loops = [["00", "01", "02"], ["00", "10", "20"]]
    network = pointmorph.trace_network(SOURCE, TARGET, FEATURES, loop=loops)
    first = [{curve.start, curve.end} for curve in network.curves[:6]]
    assert first == [{loop[k], loop[(k + 1) % 3]} for loop in loops for k in range(3)]
    morph = pointmorph.morph(SOURCE, TARGET, FEATURES, loop=loops, method="paper")
    assert morph.report["domain"] == "network"
    assert [set(ends) for ends in morph.report["curves"][:6]] == first


OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
EIGHT = [[a, b, c] for a in (0, 3) for b in (1, 4) for c in (2, 5)]
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
FOUR = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [(OCTAHEDRON, EIGHT), (CUBE, SQUARES), (TETRAHEDRON, FOUR)],
    ids=["octahedron", "cube", "tetrahedron"],
)
def test_meshes_of_few_vertices_are_cut_on_their_faces(
    vertices: np.ndarray, faces: list[list[int]]
) -> None:
    count = len(vertices)
    faces = [list(f) if np.linalg.det(vertices[f[:3]]) > 0 else list(f)[::-1] for f in faces]
    source, target = (pointmorph.Cloud(size * vertices, faces=faces) for size in (1.0, 2.0))
    network = pointmorph.trace_network(source, target, {str(k): (k, k) for k in range(count)})
    corners = {end for curve in network.curves for end in (curve.start, curve.end)}
    assert len(corners) - len(network.curves) + len(network.patches) == 2
    assert {str(k) for k in range(count)} <= corners
    planes = np.array([np.cross(*(vertices[f[1:3]] - vertices[f[0]])) for f in faces])
    planes /= (planes * vertices[[f[0] for f in faces]]).sum(axis=1)[:, None]
    for curve in network.curves:
        for points, size in ((curve.source, 1.0), (curve.target, 2.0)):
            for point, end in ((points[0], curve.start), (points[-1], curve.end)):
                if end.isdigit():
                    np.testing.assert_allclose(point, size * vertices[int(end)], atol=1e-9)
            assert len(points) > 10
            assert np.abs((points @ planes.T).max(axis=1) / size - 1).max() < 0.1  # on its faces
    assert list(network.source) == list(network.target) == count * [-1]


def test_names_and_loops_dont_mix() -> None:
    with pytest.raises(pointmorph.FeatureError, match="feature names, or sequences of them"):
        pointmorph.morph(SOURCE, TARGET, FEATURES, loop=["00", ["01", "02"]])  # type: ignore[list-item]


def test_the_command_line_takes_several_loops(tmp_path: Path) -> None:
    for name, cloud in (("a.xyz", SOURCE), ("b.xyz", TARGET)):
        np.savetxt(tmp_path / name, cloud.positions)
    content = {"features": FEATURES, "loop": [["00", "01", "02"], ["00", "10", "20"]]}
    (tmp_path / "features.json").write_text(json.dumps(content))
    arguments = ["morph", str(tmp_path / "a.xyz"), str(tmp_path / "b.xyz")]
    arguments += ["--out", str(tmp_path / "out"), "--features", str(tmp_path / "features.json")]
    assert cli.main([*arguments, "--method", "paper"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["domain"] == "network"
    assert report["patches"] == len(report["curves"]) - len(FEATURES)
