"""Shapes: samples of a surface with outward normals, and triangles; the input of every feature.

A path, arrays or the mesh of another library come in, and a checked, repaired `Shape` goes out
(`as_shape` in reading.py; diagnosis.py says what is wrong, repair.py mends it without moving a
vertex, normals.py completes the normals). Shapes never change. What follows from one is computed
when it is first asked for: areas, edges, twins and the solid's boundary (surface.py), neighbours
(graph.py), creases (creases.py), noise (noise.py). refinement.py samples the same surface more
densely (thesis 3.2.1), union.py unites pieces that overlap or touch, labels.py holds partitions of
a surface (thesis 6.3), and samples.py makes shapes by code.

Read shape.py and surface.py first. A quantity that follows from points and faces alone is a
property of `Surface`; kernels over faces and vertices stand in _kernels.py.
"""
