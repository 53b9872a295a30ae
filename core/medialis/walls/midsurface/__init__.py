"""Midsurfaces: the sheets in the middle of thin walls, welded where they meet.

In: the balls of a solid. Out: one mesh of sheets with their thickness, for shell elements. The
faces on one side of a wall move to the centers of their balls, sheets are extended, cut along each
other and meshed evenly (Botsch and Kobbelt 2004). Not in the thesis.

Read `midsurface.py` first, which has the steps in their order: `sides.py` (walls and their
sheets), `junctions.py` (cuts), `curves.py` (shared curves), `remeshing.py`.
"""
