"""Shortest paths on a surface, and the importance that they give balls (thesis 3.3).

A mesh and pairs of vertices come in; `GeodesicPaths`, lengths and directions at both ends, or
`Geodesic` polylines come out. Between the feature points of balls the lengths are their
`Importance` (thesis 3.3.1-3.3.2).

Read `geodesics.py` first: plane cuts, shortened, what happens where none arrives, and polylines.
Then `importance.py` (thresholds, no islands, paths of neighbours). Kernels: `_walk_kernels.py`
walks along planes and edges, `_strip_kernels.py` shortens what such a walk crosses,
`_geodesic_kernels.py` searches and follows, `_path_kernels.py` has polylines and the links of
connected importance. A new kind of path is a new `PathStatus` and a step of `trace`.
"""
