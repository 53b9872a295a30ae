"""Graphs of curves: growth, loops round handles, finishing, simplification (thesis 3.6.3).

In: balls, with what says how sure each lies on the curve skeleton. Out: a `CurveSkeleton`.

- `growth.py`: links between balls, and growth along them branch after branch; read it first.
- `loops.py`: the handles of a surface, and one loop for each.
- `finishing.py`: pruning, even nodes, smoothing; fewer nodes later, the same topology.
- `_kernels.py`: the inner parts; `BallLinks` there holds balls and the links between them.

Another rule for branches that are none belongs beside `prune` in `finishing.py`. Sources: the
thesis for the aim; Eppstein (2003), Erickson and Whittlesey (2005) for loops.
"""
