"""Screened Poisson reconstruction in its own process: `python _poisson.py IN.npz OUT.npz`.

MeshLab can't run two reconstructions at the same time in one process, nor stop one. Processes can
run side by side and be killed.
"""

import sys

import numpy as np


def main(source: str, destination: str) -> None:
    import pymeshlab

    arrays = np.load(source)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(arrays["points"], v_normals_matrix=arrays["normals"]))
    # More threads would change the order of sums.
    meshes.generate_surface_reconstruction_screened_poisson(
        depth=int(arrays["depth"]), scale=float(arrays["scale"]), threads=1
    )
    mesh = meshes.current_mesh()
    np.savez(destination, positions=mesh.vertex_matrix(), faces=mesh.face_matrix().astype(np.int32))


if __name__ == "__main__":
    main(*sys.argv[1:])
