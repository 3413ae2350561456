#!/usr/bin/env bash
# Seconds from the program's start to its first frame, with no compiled kernels and with them: perf/start.sh [ISOSKIN]
set -euo pipefail
cd "$(dirname "$0")/.."
isoskin=${1:-build/release/isoskin}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export POCL_CACHE_DIR=$work/kernels TIMEFORMAT='%R s (%U s of one core)'

for input in 'dam_break/dam_break.%04d.vdb --frames 27:27' 'two_points.toml --frames 1:1' 'metaballs7.toml --frames 1:1' \
  'metaballs60.toml --frames 1:1'; do
  rm -rf "$POCL_CACHE_DIR" && mkdir "$POCL_CACHE_DIR"
  for start in cold warm warm warm; do
    # shellcheck disable=SC2086  # an input and its options
    seconds=$({ time "$isoskin" track tests/data/$input -o "$work/out" --quiet; } 2>&1)
    printf '%-45s %s  %s\n' "$input" "$start" "$seconds"
  done
done
