"""Screened Poisson reconstruction, a process of its own: `python _poisson.py IN.npz OUT.npz`.

MeshLab's can't run twice in one process at a time and can't be stopped; a process can.
"""

import sys

import numpy as np


def main(given: str, wanted: str) -> None:
    import pymeshlab

    arrays = np.load(given)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(arrays["points"], v_normals_matrix=arrays["normals"]))
    # More threads would change the order of sums.
    meshes.generate_surface_reconstruction_screened_poisson(
        depth=int(arrays["depth"]), scale=float(arrays["scale"]), threads=1
    )
    mesh = meshes.current_mesh()
    np.savez(wanted, positions=mesh.vertex_matrix(), faces=mesh.face_matrix().astype(np.int32))


if __name__ == "__main__":
    main(*sys.argv[1:])
