"""The compact medial mesh of a shape: n balls with the topology of the solid and a small error.

A fine complex with the right topology is collapsed to a few balls, fitted to the surface, and
refined where it is worst; every step keeps the homotopy type.
"""

from __future__ import annotations

from dataclasses import dataclass

from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import Options, algorithm, choice, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_together
from medialis.medial_meshes.fine_complex import FineComplex, fine_complex
from medialis.medial_meshes.fitting import Bounds
from medialis.medial_meshes.mesh import Complex, LateCollapse, MedialMesh
from medialis.medial_meshes.sampling import Solid
from medialis.medial_meshes.search import Base, Search, coarser, collapse, planes_of
from medialis.shape.shape import Shape

QUALITIES = ("balanced", "fast", "best")

SAMPLES_A_BALL = 4
"""Samples of the fine complex for each ball wanted, at least."""

FEWER = 0.85
"""Share of the balls that a better fit tries to reach an error with."""

STUCK, NO_BETTER = 2, 0.9
"""Twice as many balls, this often, have to lower the error below this share of it."""


@dataclass(frozen=True, kw_only=True)
class MedialMeshOptions(Options):
    """Options of `medial_mesh`."""

    balls: int = whole(
        120,
        "Balls",
        "Number of balls; the topology of the shape may need more than very few.",
        low=1,
        high=20_000,
    )
    error: float = length(
        0.0,
        "Largest error",
        "Use as few balls as reach this distance between envelope and surface; 0 uses the number "
        "of balls.",
        high=0.5,
    )
    quality: str = choice(
        "balanced",
        "Quality",
        "fast: fewer steps of the fit. best: more balls are moved to where they are needed.",
        QUALITIES,
    )
    samples: int = whole(
        5000,
        "Samples",
        "Samples of the fine complex, about; more where the shape is thin or its topology needs "
        "them.",
        low=100,
        high=1_000_000,
        advanced=True,
    )
    relief: float = length(
        0.002,
        "Relief",
        "Bumps that stand out less leave no branch in the fine complex.",
        high=0.1,
        advanced=True,
    )
    seed: int = whole(
        0, "Seed", "Another one draws other samples.", low=0, high=2**31 - 1, advanced=True
    )


@algorithm(MedialMeshOptions)
def medial_mesh(shape: Shape, options: MedialMeshOptions, progress: Progress) -> MedialMesh:
    """Compute the medial mesh of a closed shape: few balls, connected as the solid is.

    The union of the balls, and of the cones and slabs between balls that an edge or a triangle
    joins, is near the solid, and the complex has its parts, loops and hollows.

    Parameters
    ----------
    shape : Shape
        A mesh of m faces, best closed. What is inside an open one is told by how often the surface
        is wound round a place; a message says so.

    Returns
    -------
    MedialMesh
        With its levels of detail (`MedialMesh.level`).

    Raises
    ------
    InvalidShapeError
        For a cloud, and for a mesh that encloses nothing.

    See Also
    --------
    envelope_distance : how far the envelope and the surface are apart.
    envelope_surface : the envelope as a closed triangle mesh.
    write_ma : writes the mesh to a file.

    Notes
    -----
    Cost: O(m + s log s) for s samples, and a fit of O(samples + balls) a step. The thesis has no
    such mesh; its reconstruction (3.4) is of images.

    Examples
    --------
    >>> import medialis
    >>> mesh = medialis.medial_mesh(medialis.organic_shape(56), balls=12)
    >>> len(mesh), mesh.betti
    (12, (1, 0, 0))
    >>> len(mesh.level(5)), mesh.level(5).betti
    (5, (1, 0, 0))
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "A medial mesh needs a surface with faces, got a point cloud: reconstruct a surface "
            "first."
        )
    low, high = shape.bounds
    middle, scale = 0.5 * (low + high), shape.diagonal
    if scale == 0.0:
        raise InvalidShapeError("All points of the shape coincide: it encloses nothing.")
    with progress.stage("complex", 0.0, 0.4):
        base = _base(shape, options, progress)
    with progress.stage("fit", 0.4, 1.0):
        if options.error:
            found = _smallest(base, options, progress)
        else:
            found = _fitted(base, options.balls, options.quality, options, progress)
    samples = base.fine.samples
    fewer = LateCollapse(lambda: coarser(samples, found).placed(scale, middle))
    if len(found) != options.balls and not options.error:
        _note_count(len(found), options.balls, progress)
    return MedialMesh.of(
        found.placed(scale, middle),
        finer=base.sequence.placed(scale, middle),
        coarser=fewer,
    )


def _base(shape: Shape, options: MedialMeshOptions, progress: Progress) -> Base:
    """Return the fine complex and its collapse, kept for other numbers of balls."""
    balls = 0 if options.error else options.balls
    count = max(options.samples, SAMPLES_A_BALL * balls)

    def work() -> Base:
        low, high = shape.bounds
        assert shape.faces is not None
        solid = Solid((shape.points - 0.5 * (low + high)) / shape.diagonal, shape.faces)
        with progress.stage("sampling", 0.0, 0.7):
            fine = fine_complex(solid, count, options.relief, options.seed, progress)
        with progress.stage("collapse", 0.7, 1.0):
            return _collapsed(solid, fine)

    return kept(_base, shape, (count, options.relief, options.seed), work, progress)


def _collapsed(solid: Solid, fine: FineComplex) -> Base:
    """Collapse a fine complex; meanwhile the points that bound the fits are put in order."""
    start, samples = Complex(fine.balls, fine.edges, fine.faces), fine.samples
    sequence, bounds = run_together(
        lambda: collapse(start, planes_of(samples, fine.balls, fine.pole), 1),
        lambda: Bounds(samples.points, samples.normals),
    )
    return Base(solid, fine, sequence, bounds)


def _fitted(
    base: Base, balls: int, quality: str, options: MedialMeshOptions, progress: Progress
) -> Complex:
    """Return the mesh of a number of balls."""
    return Search(base, balls, options.seed, progress).run(quality)


def _note_count(found: int, wanted: int, progress: Progress) -> None:
    why = "its topology needs them" if found > wanted else "its fine complex has no more"
    progress.note(
        f"The mesh has {counted(found, 'ball')} instead of {wanted:,}: {why}.",
        "ball_count",
        balls=found,
        wanted=wanted,
    )


def _smallest(base: Base, options: MedialMeshOptions, progress: Progress) -> Complex:
    """Return the fewest balls that reach the error wanted: doubled, then halved in between.

    That is done with fast fits; better ones then try with fewer and fewer balls.
    """
    low, high = 0, base.sequence.fewest
    best = _fitted(base, high, "fast", options, progress)
    errors = [base.error(best)]
    while errors[-1] > options.error:
        stuck = len(errors) > STUCK and errors[-1] > NO_BETTER * errors[-1 - STUCK]
        if stuck or len(best) == len(base.sequence.start):
            _note_error(errors[-1], len(best), options.error, progress)
            return best
        low, high = high, 2 * high
        best = _fitted(base, high, "fast", options, progress)
        errors.append(base.error(best))
    while high - low > max(1, high // 16):
        middle = (low + high) // 2
        found = _fitted(base, middle, "fast", options, progress)
        if base.error(found) <= options.error:
            best, high = found, middle
        else:
            low = middle
    while options.quality != "fast" and len(best) > base.sequence.fewest:
        fewer = int(FEWER * len(best))
        found = _fitted(base, fewer, options.quality, options, progress)
        if len(found) >= len(best) or base.error(found) > options.error:
            break
        best = found
    return best


def _note_error(found: float, balls: int, wanted: float, progress: Progress) -> None:
    progress.note(
        f"The error of {wanted:.2g} diagonals was not reached: with {counted(balls, 'ball')} it is "
        f"{found:.2g}, and more balls do not lower it. More samples may.",
        "error_not_reached",
        error=found,
        wanted=wanted,
    )
