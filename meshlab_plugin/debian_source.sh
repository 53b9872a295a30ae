#!/usr/bin/env bash
# Put the source of Debian's MeshLab (headers of MeshLab and vcglib) into a folder:
#   meshlab_plugin/debian_source.sh build/meshlab-2020.09
# The machine's package sources stay as they are: apt works on a copy of Debian's, as source lines.
set -euo pipefail
folder=${1:-build/meshlab-2020.09}
[ -e "$folder/src/common/interfaces.h" ] && exit 0
state=$(mktemp -d)
trap 'rm -rf "$state"' EXIT
mkdir -p "$state/lists/partial" "$state/parts" "$state/source"
for list in /etc/apt/sources.list /etc/apt/sources.list.d/{debian,ubuntu}.{sources,list}; do
    [ -e "$list" ] || continue
    sed -E 's/^Types:.*/Types: deb-src/; s/^deb /deb-src /' "$list" >"$state/parts/$(basename "$list")"
done
# apt reads the old one-line format from files named *.list only.
if [ -e "$state/parts/sources.list" ]; then mv "$state/parts/sources.list" "$state/parts/main.list"; fi
options=(-qq -o "Dir::Etc::SourceList=/dev/null" -o "Dir::Etc::SourceParts=$state/parts"
    -o "Dir::State::Lists=$state/lists" -o "Dir::Cache::srcpkgcache=" -o "Dir::Cache::pkgcache="
    -o "APT::Sandbox::User=$(id -un)")
apt-get "${options[@]}" update
(cd "$state/source" && apt-get "${options[@]}" --download-only source meshlab)
mkdir -p "$folder"
tar -xf "$state"/source/meshlab_*.orig.tar.* -C "$folder" --strip-components=1
