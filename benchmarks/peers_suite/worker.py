"""Runs one method on all shapes, in the environment of its package; imports no medialis for others.

    python worker.py METHOD SETTINGS-AS-JSON FOLDER-OF-SHAPES FOLDER-OF-RESULTS
    python worker.py versions PACKAGE ...

Writes an NPZ file for each shape: nodes and edges, or voxels, or thickness (of the vertices, or of
other places); and the seconds of
processors that the call took, all threads together. The first shape is done twice, and the second
time counts: what is loaded or compiled at first use is left out for everybody.
"""

from __future__ import annotations

import importlib.metadata
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np


def medialis_curve(case):
    """Curve skeleton, the whole operation."""
    import medialis

    curve = medialis.run("curve_skeleton", (case.points, case.faces)).graph
    medialis.forget()
    return {"nodes": curve.nodes, "edges": curve.edges}


def medialis_thickness(case):
    """Thickness, the whole operation."""
    import medialis

    values = medialis.run("thickness", (case.points, case.faces)).layers[0].attributes["thickness"]
    medialis.forget()
    return {"thickness": values}


def _mesh(case):
    import trimesh

    return trimesh.Trimesh(case.points, case.faces, process=False)


def _skeleton(found, case, fix):
    import skeletor

    if fix:  # what its manual has after the skeleton
        found = skeletor.post.clean_up(found, mesh=_mesh(case))
    return {"nodes": np.asarray(found.vertices), "edges": np.asarray(found.edges)}


def wavefront(case, fix=False, **settings):
    """Waves over the mesh."""
    import skeletor

    found = skeletor.skeletonize.by_wavefront(_mesh(case), progress=False, **settings)
    return _skeleton(found, case, fix)


def teasar(case, inv_dist, contract=False, fix=False):
    """TEASAR on the mesh."""
    import skeletor

    mesh = skeletor.pre.contract(_mesh(case), progress=False) if contract else _mesh(case)
    found = skeletor.skeletonize.by_teasar(mesh, inv_dist=inv_dist * case.across, progress=False)
    return _skeleton(found, case, fix)


def clusters(case, sampling_dist, fix=False):
    """Contraction of the mesh, then clusters of its vertices."""
    import skeletor

    thin = skeletor.pre.contract(_mesh(case), progress=False)
    found = skeletor.skeletonize.by_vertex_clusters(
        thin, sampling_dist=sampling_dist * case.across, progress=False
    )
    return _skeleton(found, case, fix)


def edge_collapse(case, fix=False):
    """Contraction of the mesh, then collapses of its edges."""
    import skeletor

    thin = skeletor.pre.contract(_mesh(case), progress=False)
    return _skeleton(skeletor.skeletonize.by_edge_collapse(thin, progress=False), case, fix)


def mean_curvature(case, fix=False, **settings):
    """Mean curvature flow with collapses."""
    import skeletor

    found = skeletor.skeletonize.by_mean_curvature(_mesh(case), progress=False, **settings)
    return _skeleton(found, case, fix)


def tangent_ball(case, fix=False):
    """Shrinking balls."""
    import skeletor

    return _skeleton(skeletor.skeletonize.by_tangent_ball(_mesh(case)), case, fix)


def kimimaro(case, fine=False, **settings):
    """TEASAR on voxels, whose lengths are left in voxels."""
    import kimimaro
    from kimimaro.intake import DEFAULT_TEASAR_PARAMS

    volume, pitch, origin = case.grid(fine)
    given = {}
    if settings:
        settings["const"] *= case.across / pitch
        given = {"teasar_params": {**DEFAULT_TEASAR_PARAMS, **settings}, "dust_threshold": 0}
    found = kimimaro.skeletonize(volume.astype(np.uint8), progress=False, **given)[1]
    return {"nodes": origin + pitch * np.asarray(found.vertices), "edges": np.asarray(found.edges)}


def local_separators(case):
    """Local separators of the graph of the mesh, from coarse to fine; radii are not kept."""
    from pygel3d import graph, hmesh

    mesh = hmesh.Manifold.from_triangles(case.points, case.faces)
    found = graph.MSLS_skeleton(graph.from_mesh(mesh))
    rows = list(found.nodes())
    number = {row: place for place, row in enumerate(rows)}
    nodes = found.positions()[rows]
    links = {tuple(sorted((number[a], number[b]))) for a in rows for b in found.neighbors(a)}
    return {"nodes": nodes, "edges": np.array(sorted(links), int).reshape(-1, 2)}


def skeletonize(case, fine=False):
    """Thinning of voxels."""
    from skimage.morphology import skeletonize

    volume, pitch, origin = case.grid(fine)
    line = skeletonize(volume) > 0
    return {"voxels": line, "pitch": pitch, "origin": origin}


def skan(case):
    """Thinning of voxels, and the graph that skan makes of it."""
    from skan import Skeleton
    from skimage.morphology import skeletonize

    volume, pitch, origin = case.grid(False)
    found = Skeleton(skeletonize(volume) > 0)
    links = found.graph.tocoo()
    nodes = origin + pitch * np.asarray(found.coordinates, float)
    return {"nodes": nodes, "edges": np.stack([links.row, links.col], axis=1)}


def cgal(case, quality=None):
    """Mean curvature flow."""
    program = Path(case.folder) / "cgal_skeleton"
    lines = [f"OFF\n{len(case.points)} {len(case.faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in case.points.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in case.faces.tolist()]
    more = [] if quality is None else [str(quality)]
    with tempfile.TemporaryFile("w+") as mesh:  # CGAL's reader goes back, which pipes cannot
        mesh.write("\n".join(lines))
        mesh.seek(0)
        done = subprocess.run(
            [program, *more], stdin=mesh, capture_output=True, text=True, check=True
        )
    seconds, counts, *rows = done.stdout.splitlines()
    nodes, edges = map(int, counts.split())
    return {
        "nodes": np.array([row.split() for row in rows[:nodes]], float),
        "edges": np.array([row.split() for row in rows[nodes : nodes + edges]], int),
        "seconds": float(seconds),
    }


def spheres(case, **settings):
    """Thickness of the mesh by tangent spheres, or rays, from the middles of its faces.

    At vertices, whose faces are not level, the spheres of a mesh are nothing.
    """
    from trimesh.proximity import thickness

    mesh = _mesh(case)
    places = mesh.triangles_center
    return {"thickness": thickness(mesh, places, **settings), "places": places}


def diameters(case, **settings):
    """Shape diameter function."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(case.points, case.faces))
    meshes.compute_scalar_by_shape_diameter_function_per_vertex(**settings)
    return {"thickness": meshes.current_mesh().vertex_scalar_array()}


def voxel_thickness(case, fine=False):
    """Local thickness of voxels."""
    from localthickness import local_thickness

    volume, pitch, origin = case.grid(fine)
    radius = local_thickness(volume)
    # Each vertex has the value of the nearest voxel inside.
    inner = np.argwhere(volume)
    from scipy.spatial import cKDTree

    near = cKDTree(origin + pitch * inner).query(case.points)[1]
    return {"thickness": 2 * pitch * radius[tuple(inner[near].T)]}


def _case(path: Path) -> SimpleNamespace:
    with np.load(path) as held:
        case = SimpleNamespace(**held, folder=str(path.parent))
    case.across = float(case.across)

    def grid(fine):
        end = "_fine" if fine else ""
        return tuple(getattr(case, name + end) for name in ("volume", "pitch", "origin"))

    case.grid = grid
    return case


def main(name: str, settings: str, shapes: str, results: str) -> None:
    """Run a method on every shape."""
    function, given = globals()[name], json.loads(settings)
    paths = sorted(Path(shapes).glob("*.npz"))
    done = False
    for path in paths:
        case = _case(path)
        try:
            if not done:
                function(case, **given)
                done = True
            before = time.process_time()
            found = function(case, **given)
            seconds = time.process_time() - before
            np.savez(Path(results) / path.name, **{"seconds": seconds, **found})
        except Exception as error:  # noqa: BLE001 - any package may raise anything
            reason = f"{type(error).__name__}: {error}"
            (Path(results) / f"{path.stem}.txt").write_text(" ".join(reason.split())[:200])


if __name__ == "__main__":
    if sys.argv[1] == "versions":
        print(json.dumps({name: importlib.metadata.version(name) for name in sys.argv[2:]}))
    else:
        main(*sys.argv[1:])
