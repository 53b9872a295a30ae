"""The curve skeleton of a mesh from its surface skeleton (thesis 3.6).

In: a `MedialCloud` with all inner balls of a mesh. Out: a `CurveSkeleton` with the node of each
sample, one component for each of the surface and one loop for each handle.

- `skeleton.py`: the algorithm from end to end; read it first.
- `candidates.py`: which balls lie on the curve skeleton, and how much of the surface hangs on each
  (thesis 3.6.1, 3.6.2); `_kernels.py` is its inner part.

The graph itself (thesis 3.6.3) grows in `curves/growth.py`. Another measure of candidates belongs
beside `candidate_measure`.
"""
