"""Surface skeletons: maximal balls, how important each is, and triangles between their centers.

A shape comes in; out come a `MedialCloud` (one ball for each sample of the surface, thesis 3.2),
the `Importance` of its balls (geodesics between their feature points, thesis 3.3, in `importance/`)
and a `SkeletonMesh` (thesis 3.4.1). Nearly every other feature begins with the balls.

Read `surface_skeleton.py` first: it tells the steps, from the noise of the mesh to the fans at its
creases. `medial_cloud.py` has the result type and the balls that samples constrain,
`triangle_balls.py` what triangles change in them, `skeleton_mesh.py` the triangles, `rims.py` what
cleans their rims. What operations of other features show of balls is in `layers.py`; the
operations, those of importance and geodesics too, are in `operation.py`.
A new way to constrain balls is a step of `maximal_balls`; a new measure of balls goes beside
`local_measures` in `importance/importance.py`.
"""
