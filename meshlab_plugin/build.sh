#!/usr/bin/env bash
# Build the plugin for the MeshLab 2020.09 of Debian and Ubuntu:
#   apt install cmake g++ meshlab qtbase5-dev libqt5opengl5-dev libglew-dev libeigen3-dev xz-utils
#   meshlab_plugin/build.sh                     gets the source that the package was made from
#   MESHLAB_SOURCE=folder meshlab_plugin/build.sh      takes one that is here
# and leave it in build/plugin-2020.09, where `medialis meshlab-install` finds it. For another
# MeshLab call CMake as in docs/meshlab.md. PYTHON names an interpreter that can import numpy.
set -euo pipefail
cd "$(dirname "$0")/.."
source=${MESHLAB_SOURCE:-$PWD/build/meshlab-src}
[ -d "$source/src/common" ] || meshlab_plugin/debian_source.sh "$source"
for libraries in /usr/lib/*/meshlab /usr/lib/meshlab; do
    [ -e "$libraries/libmeshlab-common.so" ] && break
done
python=$("${PYTHON:-python3}" -c 'import sys; print(sys.executable)')
cmake -S meshlab_plugin/filter_medialis -B build/plugin-2020.09 -DMESHLAB_SOURCE="$source" \
    -DMESHLAB_LIBRARIES_FOLDER="$libraries" -DMESHLAB_VERSION=2020.09 -DPython3_EXECUTABLE="$python"
cmake --build build/plugin-2020.09
