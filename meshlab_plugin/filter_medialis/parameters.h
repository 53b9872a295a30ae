// Parameters of a filter: as fields of MeshLab's dialog, and as arguments of the command line.
#pragma once

#include "filter_entry.h"

#include "meshlab_compat.h"

// Whether a person looks on; scripts (pymeshlab) get edges, points and no hidden layers.
bool inDialogs();

void addParameters(const FilterEntry& filter, const MeshModel& model, RichParameterList& list);

// What differs from its default, lengths in per cent. Throws a Problem, in the units of the dialog,
// for a number out of its range. `folder` is for files that hold the selection.
QStringList argumentsOf(const FilterEntry& filter, const RichParameterList& values,
                        const CMeshO& mesh, const QString& folder);
