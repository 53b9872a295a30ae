"""Wall thickness, thin spots and the curve skeleton of a mesh in PyVista.

python pyvista_thickness.py [mesh file] [picture.png]

Needs `pip install pyvista medialis`. With a picture no window opens.
"""

import sys

import numpy as np
import pyvista

import medialis


def scene(shape: medialis.Shape, picture: str | None = None) -> pyvista.Plotter:
    """Return a plotter with a shape coloured by thickness, and its skeleton beside it."""
    result = medialis.run("thickness", shape)
    walls = medialis.to_pyvista(result)  # the shape that was given, with "thickness" in point_data
    plotter = pyvista.Plotter(shape=(1, 2), off_screen=picture is not None)
    plotter.add_mesh(walls, scalars="thickness", cmap="viridis_r", smooth_shading=True)
    spots = [spot for spot in result.values["spots"] if spot["kind"] == "wall"]
    if spots:
        places = np.array([spot["position"] for spot in spots])
        texts = [f"{spot['value']:.3g}" for spot in spots]
        plotter.add_point_labels(places, texts, point_color="red", always_visible=True)

    plotter.subplot(0, 1)
    plotter.add_mesh(walls, color="lightgray", opacity=0.2)
    curve = medialis.run("curve_skeleton", shape).graph
    lines = medialis.to_pyvista(curve)  # "radius" and "branch" in point_data
    plotter.add_mesh(lines, scalars="branch", cmap="tab10", line_width=4, show_scalar_bar=False)
    # Balls themselves: a sphere at every tenth node, as wide as the shape is there.
    nodes = pyvista.PolyData(np.array(curve.nodes[::10]))
    nodes["radius"] = 2 * curve.radii[::10]
    balls = nodes.glyph(scale="radius", orient=False, geom=pyvista.Sphere(radius=0.5))
    plotter.add_mesh(balls, color="tan", opacity=0.15)
    plotter.link_views()
    return plotter


def main(file: str = "", picture: str | None = None) -> None:
    """Show a file, or the built-in shape."""
    shape = medialis.read_shape(file) if file else medialis.organic_shape()
    plotter = scene(shape, picture)
    if picture is None:
        plotter.show()
    else:
        plotter.screenshot(picture)
        plotter.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
