#!/usr/bin/env bash
# Make an environment with the bpy module for each Blender that tests/blender runs in:
# .venv-bpy-4.2 and .venv-bpy-4.5 (Python 3.11), .venv-bpy-5.2 (Python 3.13).
#
# scipy and threadpoolctl are the very wheels that the extension bundles; they stay in build/wheels,
# where test_packaging.py takes them from. As in the extension there is no numba: kernels are made
# ahead for both Pythons, beside their sources, by environments of their own (build/kernels-env-*).
# Interpreters: PYTHON311 and PYTHON313, or python3.11 and python3.13 on the PATH, or pyenv's. A
# Blender whose Python is not there is left out with a word, and one that BLENDERS does not name
# ("4.2 5.2") without.
set -euo pipefail
cd "$(dirname "$0")/../.."
BUILD=blender_addon/packaging/build_extension.py
# An environment older than one of these is brought up to date.
SOURCES=(pyproject.toml tests/blender/make_hosts.sh "$BUILD" blender_addon/packaging/wheels-*.txt)

find_python() { # VERSION: prints an interpreter of that version that can make environments
    local named="PYTHON${1/./}" candidate
    for candidate in "${!named:-}" "python$1" "$HOME/.pyenv/versions/$1".*/"bin/python$1"; do
        if "$candidate" -c "import sys, ensurepip, venv
sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
}

make_host() { # BLENDER PYTHON NUMPY
    case " ${BLENDERS:-$1} " in *" $1 "*) ;; *) return ;; esac
    local host=".venv-bpy-$1" python wheels
    local stamp="$host/installed"
    if [ -e "$stamp" ] && [ -z "$(find "${SOURCES[@]}" -newer "$stamp")" ]; then
        "$host/bin/python" "$BUILD" --kernels # what has changed
        return
    fi
    python=$(find_python "$2")
    if [ -z "$python" ]; then
        echo "No tests in Blender $1: Python $2 was not found (PYTHON${2/./}=path names one)."
        return
    fi
    echo "Making $host with $python ..."
    "$host/bin/python" -m pip --version >/dev/null 2>&1 || "$python" -m venv "$host"
    "$host/bin/python" -m pip install --quiet "bpy==$1.*" "$3" 'pytest>=8' 'setuptools>=77'
    "$host/bin/python" -m pip uninstall --quiet --yes numba llvmlite # earlier hosts had them
    wheels=$("$host/bin/python" "$BUILD" --here --wheels-only)
    echo "$wheels" | tr '\n' '\0' |
        xargs -0 "$host/bin/python" -m pip install --quiet --no-deps --no-index
    "$host/bin/python" "$BUILD" --kernels
    "$host/bin/python" -m pip install --quiet --no-deps --no-build-isolation --editable .
    touch "$stamp"
}

# numpy is Blender's own: 1.24 in the 4.2 application; the later bpy modules ask for what they have.
make_host 4.2 3.11 'numpy==1.24.*'
make_host 4.5 3.11 'numpy<2'
make_host 5.2 3.13 'numpy<2.7' # the newest that the bundled scipy takes
