# Made by docs/make_run_signatures.py from the registry.
from typing import Any, Literal, overload

from medialis.base.device import Device
from medialis.base.options import Length
from medialis.base.progress import Progress, ProgressCallback
from medialis.shape.reading import ShapeLike
from medialis.show.result import Result

@overload
def run(
    name: Literal["surface_skeleton"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    side: Literal["inner", "outer", "both"] = "inner",
    importance: bool = True,
    threshold: float | str | Length = "auto",
    subsample: float | str | Length = 0.0,
    largest_radius: float | str | Length = 1.0,
    fans: bool = True,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["skeleton_importance"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    threshold: float | str | Length = 0.0,
    connected: bool = True,
    reconstruct: bool = False,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
    directions: int = 20,
) -> Result: ...
@overload
def run(
    name: Literal["ball_reconstruction"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    size: int = 700,
    progressive: bool = False,
    order: Literal["radius", "spoke_angle"] = "radius",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["thickness"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    threshold: float | str | Length = 0.0,
    spots: int = 10,
    prominence: float = 0.25,
    min_spoke_angle: float = 120.0,
    kind: Literal["diameter", "radius"] = "diameter",
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["wall_check"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    minimum: float | str | Length = 0.0,
    maximum: float | str | Length = 0.0,
    material: Literal[
        "none", "ABS", "LCP", "PA", "PBT/PET", "PC", "PE", "PMMA", "POM", "PP", "PPS", "PS", "PUR"
    ] = "none",
    process: Literal[
        "none", "FDM", "SLA", "SLS", "moulding", "die_casting", "sand_casting"
    ] = "none",
    rules: str = "",
    gap: float | str | Length = 0.0,
    line_width: float | str | Length = 0.0,
    rib_ratio: float | Literal["auto"] = "auto",
    min_spoke_angle: float = 150.0,
    regions: int = 100,
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["midsurface"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    refine: float | str | Length = "auto",
    edge: float | str | Length = 0.02,
    angle: float = 150.0,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["geodesic_path"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    start: int = 0,
    end: int = 1,
    pairs: str = "",
    directions: int = 20,
) -> Result: ...
@overload
def run(
    name: Literal["skeleton_mesh"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    side: Literal["inner", "outer", "both"] = "inner",
    min_spoke_angle: float = 45.0,
    importance: float | str | Length = 0.0,
    smallest_piece: float | str | Length = 0.01,
    bridge: int = 2,
    clean_rims: bool = True,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["medial_mesh"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    balls: int = 120,
    error: float | str | Length = 0.0,
    quality: Literal["balanced", "fast", "best"] = "balanced",
    cell: float | str | Length = 0.01,
    cover: bool = False,
    levels: int = 0,
    importance: bool = False,
    threshold: float | str | Length = 0.0,
    edited: str = "",
    samples: int | Literal["auto"] = "auto",
    relief: float | str | Length = 0.002,
    seed: int = 0,
    denoise: Literal["auto", "off"] = "auto",
) -> Result: ...
@overload
def run(
    name: Literal["convex_pieces"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    error: float | str | Length = 0.02,
    pieces: int = 64,
) -> Result: ...
@overload
def run(
    name: Literal["curve_skeleton"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    threshold: float | str | Length = "auto",
    smoothing: float = 0.7,
    simplify: float | str | Length = 0.0,
    skeleton_method: Literal["auto", "balls", "level_sets"] = "auto",
    candidates: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["centerline"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    places: str = "",
    starts: int = 1,
    step: float | str | Length = 0.005,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["tree_cylinders"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    root: str = "",
    cylinder_length: float = 3.0,
    taper: bool = False,
    threshold: float | str | Length = "auto",
    smoothing: float = 0.7,
    simplify: float | str | Length = 0.0,
    skeleton_method: Literal["auto", "balls", "level_sets"] = "auto",
    candidates: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["view_curve_skeleton"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    pairs: int = 100,
    size: int = 512,
    saliency: float = 1.0,
    angle: float = 20.0,
) -> Result: ...
@overload
def run(
    name: Literal["armature"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    threshold: float | str | Length = "auto",
    bend: float = 0.4,
    bone_length: float | str | Length = 1.0,
    blend: float = 1.0,
    shortest: float = 1.0,
    skin_smoothing: float = 0.3,
    smoothing: float = 0.7,
    candidates: float | str | Length = "auto",
    figures: bool = True,
    naming: Literal["plain", "rigify", "mixamo", "unreal", "vrm", "numbers"] = "plain",
    poses: bool = False,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["bind"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    armature: str = "",
    poses: bool = False,
    bones_per_vertex: int = 4,
    softness: float = 0.5,
) -> Result: ...
@overload
def run(
    name: Literal["point_types"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    filter_rim: bool = False,
    side: Literal["inner", "outer", "both"] = "inner",
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["medial_sheets"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    side: Literal["inner", "outer", "both"] = "inner",
    smallest: float = 0.002,
    sheet_threshold: float = 4.0,
    creases: float = 30.0,
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
) -> Result: ...
@overload
def run(
    name: Literal["soft_edges"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    edges: Literal["convex", "concave", "both"] = "both",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["patches"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    min_angle: float = 30.0,
    smallest: float = 0.002,
    edges: Literal["convex", "concave", "both"] = "both",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["parts"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    method: Literal["auto", "limbs", "sheets"] = "auto",
    level: float = 0.5,
    count: int = 0,
    smallest: float = 0.01,
    smoothing: int = 4,
    sheet_threshold: float = 4.0,
    creases: float = 30.0,
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    denoise: Literal["auto", "off"] = "auto",
) -> Result: ...
@overload
def run(
    name: Literal["manifolds"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    cloud: Literal["points", "skeleton"] = "points",
    surfaces: bool = False,
    neighbours: int = 10,
    max_bend: float = 8.59,
    max_turn: float = 5.73,
    min_points: int = 20,
    smooth: bool = True,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
) -> Result: ...
@overload
def run(
    name: Literal["remove_outliers"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    max_bend: float = 18.0,
    max_turn: float = 12.0,
    neighbours: int = 10,
    min_points: int = 20,
    smooth: bool = True,
) -> Result: ...
@overload
def run(
    name: Literal["smooth"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    noise: float | str | Length = 0.0,
) -> Result: ...
@overload
def run(
    name: Literal["mean_shift_segments"],
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    search_radius: float | str | Length = 0.05,
    seeds: Literal["spread", "bumps", "all", "none"] = "spread",
    fill: bool = True,
    kernel: Literal["gaussian", "flat"] = "gaussian",
    last_steps: int = 0,
    merge: float | str | Length = 0.0,
    denoise: Literal["auto", "off"] = "auto",
    tolerance: float | str | Length = "auto",
    refine: float | str | Length = "auto",
    creases: float = 30.0,
    add_seeds: str = "",
    remove_seeds: str = "",
) -> Result: ...
@overload
def run(
    name: str,
    shape: ShapeLike,
    *,
    threads: int | None = None,
    device: Device | None = None,
    progress: Progress | ProgressCallback | None = None,
    **parameters: Any,
) -> Result: ...
