"""Labels of a volume as shapes with thickness and curve skeletons, as layers of napari.

python napari_layers.py labels.nii.gz

Needs `pip install "napari[all]" "medialis[volumes]"`. In a script of your own, `labels` is the
array of a Labels layer: `show(viewer, layer.data, layer.scale)`.
"""

import sys
from collections.abc import Iterator

import napari
import numpy as np
from napari.layers import Layer, Points, Surface, Vectors

import medialis


def layers(labels: np.ndarray, scale: np.ndarray) -> Iterator[Layer]:
    """Yield a surface by thickness, thin spots and a curve skeleton for each label.

    napari's coordinates are those of the axes of the array, so nothing has to be turned.
    """
    for number, shape in medialis.label_surfaces(labels, spacing=scale).items():
        walls = medialis.run("thickness", shape)
        yield Surface(
            (shape.points, shape.faces, walls.layers[0].attributes["wall_thickness"]),
            colormap="viridis",
            opacity=0.5,
            name=f"thickness of {number}",
        )
        spots = [spot for spot in walls.values["spots"] if spot["kind"] == "wall"]
        if spots:
            yield Points(
                [spot["position"] for spot in spots],
                features={"thickness": [spot["value"] for spot in spots]},
                text="thickness",
                size=0.02 * shape.diagonal,
                face_color="red",
                name=f"thin spots of {number}",
            )
        curve = medialis.run("curve_skeleton", shape).graph
        starts, ends = curve.nodes[curve.edges[:, 0]], curve.nodes[curve.edges[:, 1]]
        yield Vectors(
            np.stack([starts, ends - starts], axis=1),
            features={"branch": curve.branch},
            edge_width=0.01 * shape.diagonal,
            edge_color="branch",
            edge_colormap="hsv",
            vector_style="line",
            name=f"curve skeleton of {number}",
        )


def show(viewer: napari.components.ViewerModel, labels: np.ndarray, scale: np.ndarray) -> None:
    """Add the labels and what is made of them to a viewer."""
    viewer.add_labels(labels, scale=scale, opacity=0.2)
    for layer in layers(labels, scale):
        viewer.add_layer(layer)
    viewer.dims.ndisplay = 3


def main(file: str) -> None:
    """Open a file of nibabel in napari."""
    import nibabel

    image = nibabel.load(file)
    viewer = napari.Viewer(ndisplay=3)
    show(viewer, np.asarray(image.dataobj).astype(int), np.array(image.header.get_zooms()[:3]))
    napari.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
