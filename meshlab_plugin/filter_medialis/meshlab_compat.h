// The two plugin interfaces of MeshLab, 2020.09 and 2021.05 or later, under the same names.
#pragma once

#ifdef MEDIALIS_MESHLAB_2020
#include <common/interfaces.h>
#define MEDIALIS_PLUGIN_CLASS MeshFilterInterface
#define MEDIALIS_PLUGIN_IID MESH_FILTER_INTERFACE_IID
using FilterId = MeshCommonInterface::FilterIDType;
using FilterAction = QAction;
using FilterArity = MeshFilterInterface::FILTER_ARITY;
#define MEDIALIS_ADVANCED(advanced)
#define MEDIALIS_LOG Log
#define MEDIALIS_UPDATE_NORMALS UpdateBoxAndNormals
#else
#include <common/plugins/interfaces/filter_plugin.h>
#ifdef MEDIALIS_MESHLAB_2023
#include <common/parameters/rich_parameters.h>
#endif
#define MEDIALIS_PLUGIN_CLASS FilterPlugin
#define MEDIALIS_PLUGIN_IID FILTER_PLUGIN_IID
using FilterId = MeshLabPlugin::ActionIDType;
using FilterAction = const QAction;
using FilterArity = FilterPlugin::FilterArity;
#define MEDIALIS_ADVANCED(advanced) , advanced
#define MEDIALIS_LOG log
#define MEDIALIS_UPDATE_NORMALS updateBoxAndNormals
#endif

#ifdef MEDIALIS_MESHLAB_2023
using RichLength = RichPercentage;
inline void removeLayer(MeshDocument& document, MeshModel* model) { document.delMesh(model->id()); }
#else
using RichLength = RichAbsPerc;
using RichFileOpen = RichOpenFile;
inline void removeLayer(MeshDocument& document, MeshModel* model) { document.delMesh(model); }
#endif
