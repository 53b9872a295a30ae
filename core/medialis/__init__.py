"""Medial descriptors of 3D shapes: surface skeletons today, thickness, curves and parts to come.

Public names by stage; each is imported when it is first used, so that importing the package is
instant and loads no compiled code.

    shape = medialis.read_shape("bunny.ply")
    cloud = medialis.surface_skeleton(shape)
    result = medialis.run("surface_skeleton", shape)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from medialis.errors import (
        Cancelled,
        FileError,
        InvalidOptionError,
        InvalidShapeError,
        MedialisError,
    )
    from medialis.model.diagnosis import Diagnosis
    from medialis.model.medial_cloud import BallStatus, MedialCloud
    from medialis.model.ragged import Ragged
    from medialis.model.shape import Shape
    from medialis.operations.pictures import draw_result
    from medialis.operations.registry import OPERATIONS, operation, run
    from medialis.operations.result import Layer, Result
    from medialis.operations.writing import write_result
    from medialis.progress import Progress
    from medialis.render.reconstruction import progressive, reconstruct_image
    from medialis.shape.cloud_normals import estimate_normals
    from medialis.shape.diagnosis import diagnose
    from medialis.shape.generate import organic_shape
    from medialis.shape.normals import vertex_normals
    from medialis.shape.reading import make_shape, read_shape
    from medialis.shape.refinement import refine
    from medialis.shape.repair import Repair, repair
    from medialis.surface_skeletons.ball_shrinking import surface_skeleton
    from medialis.surface_skeletons.subsampling import uniform_subsample
    from medialis.threads import thread_count, thread_limit

_HOME = {
    "errors": "Cancelled FileError InvalidOptionError InvalidShapeError MedialisError",
    "progress": "Progress",
    "threads": "thread_count thread_limit",
    "model.diagnosis": "Diagnosis",
    "model.medial_cloud": "BallStatus MedialCloud",
    "model.ragged": "Ragged",
    "model.shape": "Shape",
    "shape.reading": "make_shape read_shape",
    "shape.diagnosis": "diagnose",
    "shape.repair": "Repair repair",
    "shape.normals": "vertex_normals",
    "shape.cloud_normals": "estimate_normals",
    "shape.refinement": "refine",
    "shape.generate": "organic_shape",
    "surface_skeletons.ball_shrinking": "surface_skeleton",
    "surface_skeletons.subsampling": "uniform_subsample",
    "render.reconstruction": "progressive reconstruct_image",
    "operations.registry": "OPERATIONS operation run",
    "operations.result": "Layer Result",
    "operations.pictures": "draw_result",
    "operations.writing": "write_result",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = [*_MODULE_OF]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'medialis' has no attribute {name!r}")
    value = getattr(import_module(f"medialis.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULE_OF])
