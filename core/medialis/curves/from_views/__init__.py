"""Curve skeletons from silhouettes and depths of a shape (thesis 3.7).

In: a shape, or pairs of `View`s that the caller has. Out: a `CurveSkeleton` with the points that it
was linked from. The shape need not be clean, closed or a mesh.

- `skeleton.py`: the algorithm from end to end; read it first.
- `views.py`: cameras and views; skeletons of silhouettes and their matching (`_kernels.py`).
- `drawing.py`: the core's renderer (`_draw_kernels.py`).
- `linking.py`: from points to a graph; `_view_kernels.py`: what many views say of points.
- `on_gpu.py`: silhouette skeletons and sharpening on a GPU (`_batch_kernels.py`).
- `operation.py`: the operation view_curve_skeleton.

Another renderer is a `ViewSource` (`view_source` sets it); hosts bring their own.
"""
