"""The viewer: one HTML file that shows a shape and its results in three dimensions.

Results of one shape come in, a page comes out that loads nothing from elsewhere. `page.py` does all
of it in Python: it decides what is shown (`scene_of`), makes short text of arrays (`Packer`),
writes the page (`viewer_page`) and opens it (`show_page`). The rest runs in the page, joined in
this order: `unpack.js`, `shaders.js`, `parts.js`, `viewer.js`, `picking.js`, `legend.js`,
`panel.js`, `start.js`. It draws with three.js, which `core/viewer_library/build.py` puts beside
these files. Another thing to see: an entry in `_described`, and its script.
"""
