"""Robots: simple shapes for planners and simulators, in the place of meshes.

In: the path of a URDF file with its meshes. Out: `RobotBalls`, the balls or capsules of each link
in its frame, and files of them (YAML of cuRobo, SRDF, URDF, MuJoCo, JSON). Or in: a shape; out:
`ConvexPieces`, few convex meshes that hold it and leave its holes open, and files for physics
engines.

- `balls.py`: from the file to the covers of all links; read it first.
- `link_solids.py`: patches of a link's surface, its inside, its medial balls.
- `covers.py`: covers of a link by 1, 2, 3, ... balls or capsules; `figures.py` measures them.
- `sharing.py`: how many each link gets; `clearances.py`: links that must not overlap.
- `urdf.py`: shapes and joints of links in, texts of balls out.
- `convex_pieces.py`: the convex decomposition; `convex_operation.py`: its operation and files.

Another file of balls is a function `NAME_text` in `urdf.py` and an ending in `write_robot_balls`.
"""
