"""Medial scaffold: which sheets meet along which curves, as a graph (thesis 6.2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from medialis.kept import Bound
from medialis.model.medial_sheets import MedialSheets
from medialis.model.y_network import YNetwork
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.sheets.sheet_meshes import SheetMeshes, sheet_meshes
from medialis.sheets.y_network import y_network
from medialis.validation import FloatArray, IntArray

GRAPHML = "http://graphml.graphdrawing.org/xmlns"


@dataclass(frozen=True, eq=False, repr=False)
class MedialScaffold(Bound):
    """Graph of sheets and Y-curves; a link joins a curve to each sheet that ends on it.

    Attributes
    ----------
    sheets : MedialSheets
        Its nodes, with ``sheets.sizes`` balls each.
    network : YNetwork
        Its curves, with ``network.lengths``.
    meshes : SheetMeshes or None
        Areas, boundaries and mean radii of the sheets; None for a point cloud.
    """

    sheets: MedialSheets
    network: YNetwork
    meshes: SheetMeshes | None

    @property
    def links(self) -> IntArray:
        """Curve and sheet of each link, (l, 2)."""
        curve, place = np.nonzero(self.network.meeting >= 0)
        return np.column_stack([curve, self.network.meeting[curve, place]]).astype(np.int32)

    def __repr__(self) -> str:
        curves = len(self.network.meeting)
        return f"MedialScaffold({self.sheets.count} sheets, {curves} curves)"

    def as_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, for strict JSON: None for what is not defined."""
        meeting: list[list[int]] = [[] for _ in self.network.meeting]
        for curve, sheet in self.links.tolist():
            meeting[curve].append(sheet)
        meshes, count = self.meshes, self.sheets.count
        measures = (
            [[None] * count] * 3
            if meshes is None
            else [_defined(m) for m in (meshes.areas, meshes.boundaries, meshes.mean_radii)]
        )
        return {
            "sheets": [
                {"sheet": i, "balls": b, "area": a, "boundary": o, "mean_radius": r}
                for i, b, a, o, r in zip(
                    range(count), self.sheets.sizes.tolist(), *measures, strict=True
                )
            ],
            "curves": [
                {"curve": i, "length": length, "sheets": meeting[i]}
                for i, length in enumerate(_defined(self.network.lengths))
            ],
        }

    def graphml(self) -> str:
        """Return the graph as GraphML, which networkx, Gephi, yEd and others read.

        Nodes are named s0, s1, ... (sheets) and c0, c1, ... (curves). What is not defined is left
        out.
        """
        root = ElementTree.Element("graphml", {"xmlns": GRAPHML})
        plain = self.as_dict()
        types = {"kind": "string", "balls": "int", "area": "double", "boundary": "double"}
        types |= {"mean_radius": "double", "length": "double"}
        for name, kind in types.items():
            about = {"id": name, "for": "node", "attr.name": name, "attr.type": kind}
            ElementTree.SubElement(root, "key", about)
        graph = ElementTree.SubElement(root, "graph", {"edgedefault": "undirected"})
        for kind, rows in (("sheet", plain["sheets"]), ("curve", plain["curves"])):
            for row in rows:
                node = ElementTree.SubElement(graph, "node", {"id": f"{kind[0]}{row[kind]}"})
                for name, value in {"kind": kind, **row}.items():
                    if name in types and value is not None:
                        ElementTree.SubElement(node, "data", {"key": name}).text = str(value)
        for curve, sheet in self.links.tolist():
            ElementTree.SubElement(graph, "edge", {"source": f"c{curve}", "target": f"s{sheet}"})
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def _defined(values: FloatArray) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


@algorithm(Options, keep=False)
def medial_scaffold(sheets: MedialSheets, options: Options, progress: Progress) -> MedialScaffold:
    """Collect sheets and the curves along which they meet to a graph.

    Parameters
    ----------
    sheets : MedialSheets
        From `medialis.medial_sheets`.

    Returns
    -------
    MedialScaffold
        With the Y-network and, for a mesh, the sheet meshes that it was made of.

    See Also
    --------
    y_network, sheet_meshes : its two halves.

    Notes
    -----
    Source: thesis 6.2.2 (the scaffold of sheets and curves).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> scaffold = medialis.medial_scaffold(medialis.medial_sheets(cloud))
    >>> len(scaffold.as_dict()["sheets"]) == scaffold.sheets.count
    True
    """
    with progress.stage("scaffold", 0.0, 1.0):
        with progress.stage("network", 0.0, 0.5):
            network = y_network.of(sheets, options, progress)
        meshes = None
        if sheets.cloud.surface.faces is not None:
            with progress.stage("meshes", 0.5, 1.0):
                meshes = sheet_meshes.of(sheets, options, progress)
    return MedialScaffold(sheets, network, meshes)
