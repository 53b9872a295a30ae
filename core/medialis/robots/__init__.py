"""Robots: balls for each link of a URDF, as planners and simulators take them.

In: the path of a URDF file with its meshes. Out: `RobotBalls`, the balls of each link in its frame,
and files of them (YAML of cuRobo, SRDF, URDF, JSON).

- `balls.py`: how many balls each link gets, and its cover; read it first.
- `urdf.py`: shapes of links in, texts of balls out.

Another file of balls is a function `NAME_text` in `urdf.py` and an ending in `write_robot_balls`.
"""
