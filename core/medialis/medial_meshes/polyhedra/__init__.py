"""The exact medial axis of polyhedra that are not convex: all their sheets, seams and junctions.

In: a solid of flat faces, without handles. Out: any number of balls on the sheets, seams and
junctions of its medial axis, enough for all of these. Convex ones are in `../roofs.py`. Not in the
thesis.

Read `parting.py` first, which has the steps; `walls.py` has the faces, what is a wall, and how a
ball is placed between walls.
"""
