#!/usr/bin/env bash
# Put the source of Debian's MeshLab (headers of MeshLab and vcglib) into a folder, without changing
# the package sources of this machine:   meshlab_plugin/debian_source.sh build/meshlab-src
set -euo pipefail
folder=${1:-build/meshlab-src}
[ -e "$folder/src/common/interfaces.h" ] && exit 0
state=$(mktemp -d)
trap 'rm -rf "$state"' EXIT
release=$(. /etc/os-release && echo "$VERSION_CODENAME")
echo "deb-src http://deb.debian.org/debian $release main" >"$state/sources.list"
mkdir -p "$state/lists/partial" "$state/source"
options=(-o "Dir::Etc::SourceList=$state/sources.list" -o "Dir::Etc::SourceParts=/dev/null"
    -o "Dir::State::Lists=$state/lists" -o "Dir::Cache::srcpkgcache=" -o "Dir::Cache::pkgcache="
    -o "APT::Sandbox::User=root" -qq)
apt-get "${options[@]}" update
(cd "$state/source" && apt-get "${options[@]}" --download-only source meshlab)
mkdir -p "$folder"
tar -xf "$state"/source/meshlab_*.orig.tar.* -C "$folder" --strip-components=1
