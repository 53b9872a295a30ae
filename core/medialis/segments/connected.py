"""Which segments of a surface are not connected, as a message (for thesis 5.3, 6.3.3)."""

from __future__ import annotations

from medialis.model.segmentation import Segmentation
from medialis.progress import Progress
from medialis.surface.labels import piece_counts
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_patiently


def tell_pieces(found: Segmentation, progress: Progress) -> None:
    """Say how many segments lie in several pieces of the surface, and in how many."""

    def count() -> list[int]:
        return piece_counts(found.labels, surface_graph(found.surface)).tolist()

    pieces = run_patiently(count, progress)
    apart = [number for number in pieces if number > 1]
    if apart:
        progress.note(
            f"{len(apart)} of {found.count} segments are not connected along the surface, as the "
            f"two walls of a sheet are not: they have {sum(apart)} pieces.",
            "segments_not_connected",
            segments=found.count,
            count=len(apart),
            pieces=sum(apart),
        )
