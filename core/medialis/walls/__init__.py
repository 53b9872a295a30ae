"""Walls: how thick a shape is, where it is too thin, ribs and gaps, midsurfaces (thesis 3.5).

In: a shape with its balls (`skeleton/`). Out: thickness on the surface, thin spots measured by
calipers, regions of the wall check with their ribs, tapers and gaps, and sheets for shell elements
(`midsurface/`). Thickness is the thesis's; what follows from it is not in the thesis.

Read `thickness.py` first, then `thin_spots.py` and `wall_check.py`; `completion.py` carries a field
to where no wall is, `ribs.py` knows walls of even thickness. Operations are declared in
`operation.py`; the next check of walls goes beside them.
"""
