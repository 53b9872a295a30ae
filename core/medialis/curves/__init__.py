"""Curve skeletons: graphs along the middle of a shape (thesis 3.6, 3.7).

In: a `MedialCloud` (balls of a mesh), or a shape or pictures of it. Out: a `CurveSkeleton`, nodes
with radii, edges and branches; it is what `segments` (limbs) and `rigging` (bones) work on.

- `curve_skeleton.py`: the result; read it first.
- `from_balls/`: from the surface skeleton of a mesh (thesis 3.6); exact topology.
- `from_views/`: from silhouettes and depths (thesis 3.7); also of clouds and of unclean meshes.
- `growth.py`: how a graph grows along linked balls; `loops.py`: handles, and a loop for each;
  `finishing.py`: pruning, even nodes, smoothing, fewer nodes. For both; `_kernels.py` is their
  inner part, where `BallLinks` holds balls and the links between them.
- `formats.py`, `operation.py`: its files (SWC, GraphML and others), the operation curve_skeleton.

Another method to find points on the curve skeleton is a folder beside `from_balls/`; what is known
of a finished graph is a property of `CurveSkeleton`. Sources besides the thesis: Eppstein (2003),
Erickson and Whittlesey (2005) for loops.
"""
