"""Segmentations of a surface by its skeleton (thesis 5.3, 6.3).

In: a `MedialCloud`. Out: a `Segmentation` (`shape/labels.py`): one label for each sample.

- `parts.py`: parts as people see them, limbs, sheets (6.3.3); read it first. Its method auto works
  on `sites.py`: even places, the share of people who put two together, and their clusters.
- `patches.py`: soft edges, and the faces between edges (6.3.1, 6.3.2).
- `mean_shift.py`: clusters of a cloud, and bumps such as teeth (5.3).
- `_kernels.py`: the inner parts of mean shift and of sites.
- `operation.py`: the operations parts, patches, soft_edges and mean_shift_segments.

Another method of parts is a function beside `_by_limbs` and `_sheet_parts` in `parts.py`; another
quantity of two sites is a line in `pair_quantities` (`benchmarks/parts.py` weighs it).
"""
