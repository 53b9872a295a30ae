"""Noisy clouds: manifolds that may cross, noise, surfaces of manifolds (thesis 4.2).

In: any points, without normals. Out: a `ManifoldSet` (which manifolds each point belongs to) and
triangles of each manifold.

- `manifolds.py`: the classification and the surfaces; read it first.
- `smoothing.py`: how far a cloud scatters, and positions without it; which points of noise are as
  dense as a surface.
- `quadrics.py`: the operation smooth on clouds; `_quadric_kernels.py` is its inner part.
- `_patch_kernels.py`: patches and their graph; `_kernels.py`: lines of scans, planes, triangles.
- `operation.py`: the operations manifolds, remove_outliers and smooth.

Another test of a neighbourhood belongs beside `_with_bent` in `manifolds.py`.
"""
