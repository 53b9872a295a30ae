// MeshLab's meshes to files of medialis and back; nothing is computed here.
#pragma once

#include "layer_file.h"

#include "meshlab_compat.h"

#include <string>

// Write the mesh in world coordinates: its own transform is applied.
void writeMesh(const CMeshO& mesh, const QString& path);

// How many vertices and faces `writeMesh` wrote.
size_t vertexCount(const CMeshO& mesh);
size_t faceCount(const CMeshO& mesh);

// Fill a new layer, or put fields on the mesh that was written. `colorBy` becomes the scalar
// (MeshLab: quality). Returns the MM_ masks of what has changed.
int fillMesh(MeshModel& model, const LayerFile& layer, const std::string& colorBy);
int putFields(MeshModel& model, const LayerFile& layer, const std::string& colorBy);

// Select the vertices whose field `selected` is 1, and no others.
int select(MeshModel& model, const LayerFile& layer);
