"""The skeletons of all shapes of a folder, in one MeshLab project.

python batch_to_meshlab.py FOLDER OUTPUT

Needs pymeshlab and `pip install "medialis[dask]"`. The batch runs in processes of its own; only its
results are loaded here.
"""

import sys
from pathlib import Path

import medialis


def main(folder: str, output: str) -> None:
    """Run the batch, then collect the shapes and their skeletons as layers."""
    rows = medialis.batch("surface_skeleton", [folder], output)
    # Not at the top: worker processes import this file, and need no pymeshlab.
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    for row in rows:
        if row.status == "failed":
            print(row.file, row.sentence)
            continue
        skeleton = Path(output, row.name, row.operation, "surface_skeleton.ply")
        meshes.load_new_mesh(row.file)
        meshes.load_new_mesh(str(skeleton))
    meshes.save_project(str(Path(output, "skeletons.mlp").resolve()))
    print(meshes.mesh_number(), "layers")


if __name__ == "__main__":
    main(*sys.argv[1:])
