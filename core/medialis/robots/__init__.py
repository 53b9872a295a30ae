"""Robots: simple shapes for planners and simulators, in the place of meshes.

In: the path of a URDF file with its meshes. Out: `RobotBalls`, the balls of each link in its frame,
and files of them (YAML of cuRobo, SRDF, URDF, JSON). Or in: a shape; out: `ConvexPieces`, few
convex meshes that hold it and leave its holes open, and files for physics engines.

- `balls.py`: how many balls each link gets, and its cover; read it first.
- `urdf.py`: shapes of links in, texts of balls out.
- `convex_pieces.py`: the convex decomposition; `convex_operation.py`: its operation and files.

Another file of balls is a function `NAME_text` in `urdf.py` and an ending in `write_robot_balls`.
"""
