"""Diagnosis: what is right and wrong with a mesh or cloud, and its measures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from medialis.kept import Described


@dataclass(frozen=True, repr=False)
class Diagnosis(Described):
    """Counts and measures of a mesh or cloud; lengths, areas, volumes in the caller's units.

    Edges and everything derived from them leave faces with a repeated corner out.
    """

    vertices: int
    faces: int
    edges: int
    closed: bool
    """Every edge has at least two faces; False for a cloud."""
    boundary_edges: int
    """Edges with one face."""
    boundary_loops: int
    nonmanifold_edges: int
    """Edges with three or more faces."""
    nonmanifold_vertices: int
    """Vertices whose faces, joined across all edges at the vertex, form several fans."""
    components: int
    """Sets of faces joined by shared vertices; 0 for a cloud."""
    genus: int | None
    """Handles, summed over the components; None for a cloud, a non-manifold or a one-sided mesh."""
    orientation: str
    """"out" or "in" (sign of the volume; open parts closed by cones), "mixed" when two faces run
    along a common edge in the same direction (so at every non-manifold edge), "none" for clouds
    and when the sign means nothing (a flat sheet)."""
    inconsistent_edges: int
    """Edges of two faces that run along them in the same direction."""
    duplicate_vertices: int
    """Vertices at exactly the place of an earlier one."""
    duplicate_faces: int
    """Faces with the same three vertices as an earlier one."""
    degenerate_faces: int
    """Faces with a repeated corner or a height of at most 1e-12 of their longest edge."""
    unused_vertices: int
    """Vertices of no face; 0 for a cloud."""
    nonfinite_vertices: int
    """Vertices with NaN or infinity; the other measures leave them out."""
    area: float
    volume: float | None
    """Signed; None when the mesh is not closed or neighbouring faces disagree."""
    diagonal: float
    """Of the bounding box of all vertices."""
    spacing: float
    """Mean edge length; for a cloud the mean distance to the nearest other point."""
    min_edge: float
    """Shortest edge; for a cloud the smallest distance to a nearest other point."""
    max_edge: float
    """Longest edge; for a cloud the largest distance to a nearest other point."""

    def as_dict(self) -> dict[str, Any]:
        """Return all fields by name, for JSON."""
        return asdict(self)

    def summary(self) -> str:
        """Return a few lines for people."""
        if self.faces == 0:
            lines = [f"point cloud of {_counted(self.vertices, 'point')}"]
        else:
            lines = [
                f"mesh of {self.vertices} vertices, {_counted(self.faces, 'face')}, {self.edges} "
                f"edges in {_counted(self.components, 'component')}",
                self._surface_line(),
            ]
        lines += self._trouble_lines()
        size = f"diagonal {self.diagonal:.6g}, spacing {self.spacing:.6g}"
        lines.append(f"{size} ({self.min_edge:.6g} to {self.max_edge:.6g})")
        if self.faces:
            volume = "none" if self.volume is None else f"{self.volume:.6g}"
            lines.append(f"area {self.area:.6g}, volume {volume}")
        return "\n".join(lines)

    def _surface_line(self) -> str:
        state = "closed" if self.closed else f"open ({_counted(self.boundary_loops, 'hole')})"
        genus = "" if self.genus is None else f", genus {self.genus}"
        if self.orientation == "mixed" and not self.inconsistent_edges:
            return f"{state}{genus}, faces agree on the outside except at non-manifold edges"
        facing = {"out": "facing outward", "in": "facing inward", "none": "outside unclear"}
        return f"{state}{genus}, {facing.get(self.orientation, 'faces disagree on the outside')}"

    def _trouble_lines(self) -> list[str]:
        troubles = (
            (self.nonmanifold_edges, "edge with three or more faces"),
            (self.nonmanifold_vertices, "vertex joining separate fans of faces"),
            (self.inconsistent_edges, "edge whose two faces disagree on the outside"),
            (self.duplicate_vertices, "duplicate vertex"),
            (self.duplicate_faces, "duplicate face"),
            (self.degenerate_faces, "face without area"),
            (self.unused_vertices, "vertex of no face"),
            (self.nonfinite_vertices, "vertex with NaN or infinity"),
        )
        return [_counted(number, what) for number, what in troubles if number]


def _counted(number: int, what: str) -> str:
    head, _, tail = what.partition(" ")
    if number != 1:
        head = "vertices" if head == "vertex" else head + "s"
        if head == "duplicates":
            head, tail = "duplicate", {"vertex": "vertices", "face": "faces"}[tail]
    return f"{number} {head} {tail}".rstrip()
