"""Curve skeletons: graphs along the middle of a shape (thesis 3.6, 3.7).

In: a `MedialCloud` (balls of a mesh), or a shape or pictures of it. Out: a `CurveSkeleton`, nodes
with radii, edges and branches; it is what `segments` (limbs) and `rigging` (bones) work on.

- `curve_skeleton.py`: the result; read it first.
- `from_balls.py`: from the surface skeleton of a mesh (thesis 3.6); exact topology.
- `from_level_sets.py`: from contours of the distance along a mesh (`level_sets.py`), for limbs far
  thinner than the whole shape.
- `limb_sampling.py`: samples on limbs that are coarse for how thin they are.
- `candidates.py`: which balls lie on the curve skeleton, and how much of the surface hangs on each
  (thesis 3.6.1, 3.6.2).
- `from_views/`: from silhouettes and depths (thesis 3.7); also of clouds and of unclean meshes.
- `growth.py`: how a graph grows along linked balls, with a loop for each handle;
  `finishing.py`: pruning, even nodes, smoothing, fewer nodes. For both; `_kernels.py` is their
  inner part, where `BallLinks` holds balls and the links between them; `_search_kernels.py` finds
  the cheapest paths along them.
- `centerline.py`: lines in the middle of tubes between places; `tree_cylinders.py`: trunk and limbs
  of a tree, from its root, as cylinders. Each has its operation beside it.
- `scanned_tree.py`: cylinders of a scanned tree, from points alone; `point_tree.py` (sections and
  what they grow from), `limb_fit.py` (axis and radii of a limb; `_circle_kernels.py`), `ground.py`.
- `operation.py`: its files (SWC, GraphML and others), and the operation curve_skeleton.

Another method to find points on the curve skeleton stands beside `from_balls.py`, another measure
of candidates beside `candidate_measure`; what is known of a finished graph is a property of
`CurveSkeleton`. Sources besides the thesis: Eppstein (2003),
Erickson and Whittlesey (2005) for loops.
"""
