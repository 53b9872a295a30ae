"""Medial scaffold: which sheets meet along which curves, as a graph (thesis 6.2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.medial_sheets import MedialSheets
from medialis.model.y_network import YNetwork
from medialis.sheets.sheet_meshes import SheetMeshes
from medialis.validation import FloatArray, IntArray

GRAPHML = "http://graphml.graphdrawing.org/xmlns"


@dataclass(frozen=True, eq=False)
class MedialScaffold:
    """Graph of sheets and Y-curves; a link joins a curve to each sheet that ends on it.

    Attributes
    ----------
    balls : (s,) int32
        Number of balls of each sheet.
    areas, boundaries, mean_radii : (s,) float64
        Of each sheet; see `SheetMeshes`. NaN without meshes.
    lengths : (c,) float64
        Of each curve.
    links : (l, 2) int32
        Curve and sheet.
    """

    balls: IntArray
    areas: FloatArray
    boundaries: FloatArray
    mean_radii: FloatArray
    lengths: FloatArray
    links: IntArray

    def as_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, for strict JSON: None for what is not defined."""
        sheets: list[list[int]] = [[] for _ in self.lengths]
        for curve, sheet in self.links.tolist():
            sheets[curve].append(sheet)
        return {
            "sheets": [
                {"sheet": i, "balls": b, "area": a, "boundary": o, "mean_radius": r}
                for i, (b, a, o, r) in enumerate(
                    zip(
                        self.balls.tolist(),
                        _defined(self.areas),
                        _defined(self.boundaries),
                        _defined(self.mean_radii),
                        strict=True,
                    )
                )
            ],
            "curves": [
                {"curve": i, "length": length, "sheets": sheets[i]}
                for i, length in enumerate(_defined(self.lengths))
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


def medial_scaffold(
    sheets: MedialSheets, network: YNetwork, meshes: SheetMeshes | None = None
) -> MedialScaffold:
    """Collect sheets and curves to a graph.

    Parameters
    ----------
    sheets : MedialSheets
        From `medialis.medial_sheets`.
    network : YNetwork
        From `medialis.y_network`.
    meshes : SheetMeshes, optional
        From `medialis.sheet_meshes`: gives areas, boundaries and radii.

    Returns
    -------
    MedialScaffold

    Raises
    ------
    InvalidShapeError
        When the three do not belong together.

    Notes
    -----
    Source: thesis 6.2.2 (the scaffold of sheets and curves).

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> sheets = medialis.medial_sheets(shape, cloud)
    >>> network = medialis.y_network(shape, cloud, sheets)
    >>> scaffold = medialis.medial_scaffold(sheets, network)
    >>> len(scaffold.as_dict()["sheets"]) == sheets.count
    True
    """
    count = sheets.count
    if int(network.sheets.max(initial=-1)) >= count or (
        meshes is not None and len(meshes.areas) != count
    ):
        raise InvalidShapeError(
            f"The network or the meshes name other sheets than 0..{count - 1}: give those of these "
            "sheets."
        )
    curve, place = np.nonzero(network.sheets >= 0)
    links = np.column_stack([curve, network.sheets[curve, place]]).astype(np.int32)
    unknown = np.full(count, np.nan)
    return MedialScaffold(
        sheets.sizes,
        unknown if meshes is None else meshes.areas,
        unknown if meshes is None else meshes.boundaries,
        unknown if meshes is None else meshes.mean_radii,
        network.lengths,
        links,
    )
