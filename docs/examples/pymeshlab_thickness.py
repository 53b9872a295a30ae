"""Thickness in pymeshlab: attributes, quality and colour on the mesh itself.

python pymeshlab_thickness.py [mesh file]
"""

import sys

import pymeshlab

import medialis
import medialis_meshlab  # noqa: F401 - adds the filters to pymeshlab

ms = pymeshlab.MeshSet()
if len(sys.argv) > 1:
    ms.load_new_mesh(sys.argv[1])
else:
    creature = medialis.organic_shape()
    ms.add_mesh(pymeshlab.Mesh(creature.points, creature.faces), "creature")

# Lengths are per cent of the bounding box diagonal, or pure values in the units of the mesh.
result = ms.compute_scalar_by_medial_thickness_per_vertex(
    kind="diameter", threshold=pymeshlab.PureValue(0.25)
)
for spot in result["spots"]:
    print("thin spot at", spot["position"], "with", spot["value"])

# The mesh stays the current one. Its quality is the thickness, so that MeshLab's filters go on.
print(ms.get_scalar_statistics_per_vertex())
ms.compute_selection_by_condition_per_vertex(condselect="q < 0.2")
print(ms.current_mesh().selected_vertex_number(), "vertices are thinner than 0.2")

# The attribute holds the exact values. A second run has a new name: the result tells it.
name = result["attributes"]["thickness"]
thickness = ms.current_mesh().vertex_custom_scalar_attribute_array(name)
again = ms.compute_scalar_by_medial_thickness_per_vertex(kind="radius")
print(name, again["attributes"]["thickness"], thickness.min())

# The thin spots are a layer of points.
for layer, number in again["layers"].items():
    print(layer, ms.mesh(number).vertex_number())

ms.save_current_mesh("thickness.ply")
