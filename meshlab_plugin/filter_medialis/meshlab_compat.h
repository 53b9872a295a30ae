// The two plugin interfaces of MeshLab, 2020.09 and 2021.05 or later, under the same names.
#pragma once

#ifdef MEDIALIS_MESHLAB_2020
#include <common/interfaces.h>
#define MEDIALIS_PLUGIN_CLASS MeshFilterInterface
#define MEDIALIS_PLUGIN_IID MESH_FILTER_INTERFACE_IID
using FilterId = MeshCommonInterface::FilterIDType;
using FilterAction = QAction;
using FilterArity = MeshFilterInterface::FILTER_ARITY;
using RichFileOpen = RichOpenFile;
#define MEDIALIS_MESH_PARAMETER(name, document, label, help) \
    RichMesh(name, (document).mm(), &(document), label, help)
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
#ifdef MEDIALIS_MESHLAB_2023
#define MEDIALIS_MESH_PARAMETER(name, document, label, help) \
    RichMesh(name, (document).mm() ? (document).mm()->id() : 0, &(document), label, help)
#else
using RichFileOpen = RichOpenFile;
#define MEDIALIS_MESH_PARAMETER(name, document, label, help) \
    RichMesh(name, const_cast<MeshModel*>((document).mm()), \
             const_cast<MeshDocument*>(&(document)), label, help)
#endif
#define MEDIALIS_ADVANCED(advanced) , advanced
#define MEDIALIS_LOG log
#define MEDIALIS_UPDATE_NORMALS updateBoxAndNormals
#endif

#ifdef MEDIALIS_MESHLAB_2023
using RichLength = RichPercentage;
inline void hide(MeshModel& model) { model.setVisible(false); }
#else
using RichLength = RichAbsPerc;
inline void hide(MeshModel& model) { model.visible = false; }
#endif
