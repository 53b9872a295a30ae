"""What people see and keep of results: pictures, pages, reports, folders of files.

In: a `Result`, or any surface. Out: pictures by a software renderer, which needs no display and no
graphics card (thesis 3.4 has its reconstruction), the page in three dimensions (`viewer/`), reports
with exact distances (`reports/`), and folders that are written whole or not at all.

Read `picture.py` first: what of a result is drawn, and how. `medial_points.py` makes sheets of
medial points; `raster.py` and `camera.py` are below it, `borders.py` and `marks.py` beside it,
`png.py` makes files of it; `writing.py` is the folder; `result.py` is what people hold, and reads
it back.
"""
