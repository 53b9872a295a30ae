#!/usr/bin/env bash
# Run tests/blender in the environments that make_hosts.sh makes, all at the same time:
#   tests/blender/run_in_hosts.sh [ARGUMENT OF PYTEST...]
#
# In the Blenders that QUICK names ("4.2") slow tests are left out.
#
# A Blender computes on one processor most of the time, and no test writes outside of its own
# temporary folder. What an environment printed is shown when it has ended.
set -uo pipefail
cd "$(dirname "$0")/../.."
shopt -s nullglob

hosts=() ended=() failed=()
for stamp in .venv-bpy-*/installed; do hosts+=("${stamp%/installed}"); done
if [ ${#hosts[@]} -eq 0 ]; then
    echo "Blender tests were left out: they need the environments of 'make hosts'."
    exit 0
fi

logs=$(mktemp -d)
stop() { # children in the background do not hear Ctrl-C
    kill $(jobs -p) 2>/dev/null
    wait
    rm -rf "$logs"
}
trap 'stop; exit 130' INT TERM

for host in "${hosts[@]}"; do # they have no compiler: what has changed is made ahead
    "$host/bin/python" blender_addon/packaging/build_extension.py --kernels || exit 1
done
echo "tests/blender in ${hosts[*]}, at the same time"
for host in "${hosts[@]}"; do
    only=()
    case " ${QUICK:-} " in *" ${host#.venv-bpy-} "*) only=(-m "not slow") ;; esac
    "$host/bin/python" -m pytest tests/blender "${only[@]}" "$@" >"$logs/${host#.}" 2>&1 &
    ended+=($!)
done
for i in "${!hosts[@]}"; do
    wait "${ended[$i]}" || failed+=("${hosts[$i]}")
    echo "tests/blender in ${hosts[$i]}"
    cat "$logs/${hosts[$i]#.}"
done
stop
if [ ${#failed[@]} -gt 0 ]; then
    echo "failed in: ${failed[*]}"
    exit 1
fi
