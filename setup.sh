#!/usr/bin/env bash
# Installs what isoskin needs to build, test and run, by Debian package name. Safe to run again: what is there stays.
#   ./setup.sh           everything the two README commands need
#   ./setup.sh --peers   also the programs perf/ compares with (VTK, CGAL)
set -euo pipefail

packages=(
  build-essential cmake ninja-build ccache clang-format git pkg-config           # build
  ocl-icd-opencl-dev opencl-clhpp-headers pocl-opencl-icd oclgrind                # OpenCL: headers, a CPU device, a checker
  libtbb-dev libglm-dev libopenvdb-dev libboost-dev libboost-iostreams-dev libqhull-dev   # core
  libtomlplusplus-dev nlohmann-json3-dev libfmt-dev libcli11-dev   # files and command line
  libembree-dev libopenexr-dev openexr libpng-dev                                # reference tracer and images
  libegl-dev libegl1 libepoxy-dev libgl1-mesa-dri                                # headless OpenGL
  libgtest-dev libgmock-dev librapidcheck-dev libbenchmark-dev                   # tests and perf
)
for option in "$@"; do
  case $option in
    --peers) packages+=(libvtk9-dev libcgal-dev) ;;
    *) echo "setup.sh: unknown option '$option'; expected --peers or nothing" >&2; exit 2 ;;
  esac
done

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  echo "setup.sh: all ${#packages[@]} packages are installed"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "setup.sh: needs root or sudo to install: ${missing[*]}" >&2; exit 2; }
  as_root=(sudo)
fi
echo "setup.sh: installing ${#missing[@]} packages: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
echo "setup.sh: done"
