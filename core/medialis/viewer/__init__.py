"""The viewer: one HTML file that shows a shape and its results in three dimensions.

`scene.py` says what is shown, `packing.py` makes short text of arrays, `page.py` the page, and
`showing.py` opens it. The rest is what runs in the page, joined in this order: `unpack.js`,
`shaders.js`, `parts.js`, `viewer.js`, `picking.js`, `legend.js`, `panel.js`, `start.js`. It draws
with three.js, which `core/viewer_library/build.py` puts beside these files.
"""
