"""Graphs of curves: growth, loops round handles, finishing, simplification (thesis 3.6.3).

In: balls, with what says how sure each lies on the curve skeleton. Out: a `CurveSkeleton`.

- `growth.py`: branch after branch, pruning, smoothing; read it first.
- `ground.py`: links between balls, and the cheapest path of each ball to the graph.
- `loops.py`: the handles of a surface, and one loop for each.
- `simplification.py`: fewer nodes later, the same topology.
- `_kernels.py`: the inner parts; `Net` there is how kernels see balls and links.

Another rule for branches that are none belongs beside `prune` in `growth.py`. Sources: the thesis
for the aim; Eppstein (2003), Erickson and Whittlesey (2005) for loops.
"""
