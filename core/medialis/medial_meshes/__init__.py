"""The compact medial mesh: a shape as n balls, connected with the topology of the solid.

In: a closed mesh. Out: balls, edges and triangles with the homotopy type of the solid, close to its
surface, with all coarser levels; covers of balls; error measures. Not in the thesis: Q-MAT and what
came after it, see each file. The folder is not called `medial_mesh`: that is the function.

Read `medial_mesh.py` first, then the steps: `sampling.py`, `fine_complex.py`, `fitting.py`;
`envelope.py` and `distances.py` say how far the balls are from the surface.
"""
