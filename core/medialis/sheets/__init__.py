"""Medial sheets: smooth pieces of a surface skeleton, and the curves where they meet (thesis 6.2).

A `MedialCloud` comes in; out come, one from the other: `FeatureSets` (all samples that each ball
touches, and from them the types of medial points), `MedialSheets` (the sheet of each ball),
`YNetwork` (the curves), `SheetMeshes` (triangles and measures) and `MedialScaffold` (the graph of
sheets and curves).

Read `sheets.py` first: it tells which balls are on one sheet, and where sheets meet. It stands on
`feature_sets.py` and on `unfolding.py`, the surface cut and spread out along creases. Curves,
meshes and the graph are in `scaffold.py`, kernels in `_kernels.py`, the operations in
`operation.py`. What else can be said of a sheet is a field of `SheetMeshes`; what else of a curve,
of `YNetwork`.
"""
