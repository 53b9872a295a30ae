"""Bones along a curve skeleton, and the weights with which they move the surface.

In: a `CurveSkeleton`, with the map from the surface for the weights; or a mesh and an `Armature`.
Out: `Bones`, `SkinWeights`.
The thesis has no rigging; it names armatures as a use of curve skeletons.

- `bones.py`: the results, bones from joint to joint, and weights by the map from the surface,
  smoothed along it; read it first.
- `limbs.py`: limbs of the tree of shortest paths, their joints, pairs of mirrored limbs.
- `naming.py`: how bones are turned, and what rigs call them. Other names are an entry of `NAMINGS`
  and a choice of the operation.
- `operation.py`: the operation armature, and rigged glTF.
- `binding.py`: weights for any `Armature` and any mesh, by the ways inside the body;
  `_way_kernels.py` searches them, `armature.py` reads and writes armatures, and
  `binding_operation.py` is the operation bind.
"""
