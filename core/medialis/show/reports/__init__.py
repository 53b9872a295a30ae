"""Reports: how well a result describes its shape, as one page and as plain data.

A result comes in; out come ``report.html`` and ``report.json`` (`report_texts` in `report.py`: read
this one first). `measures.py` measures: exact distances between surface and balls, both ways
(thesis 3.4, there in images), emptiness, centredness, topology, histograms. `page.py` says in
one line each what the numbers mean: right, to be looked at, or nothing to compare with; and it has
tables, charts and numbers of pages, for batches as well. Another measure: a function and an
entry in `measure`, a label in `report.py`, and a verdict where there is something to expect.
"""
