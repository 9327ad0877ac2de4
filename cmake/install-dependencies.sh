#!/bin/sh
# Installs what it takes to build traceur with its examples, tests and benchmarks, on Debian 12, Ubuntu 24.04 and newer.
# Does nothing where all of it is there already. Asks nothing. On other systems it prints the packages to install.
set -eu

required="g++ cmake ninja-build libeigen3-dev doctest-dev libpugixml-dev nlohmann-json3-dev libcli11-dev"
# What rests on one of these is left out of the build where the system does not offer it.
optional="libceres-dev libnlopt-dev libbenchmark-dev libmujoco-dev libbullet-dev libode-dev libdart-dev libopenmpi-dev openmpi-bin"

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
  cat >&2 <<'END'
This is neither Debian nor Ubuntu. Install these (names may differ between releases), then run cmake again:
  Fedora:   gcc-c++ cmake ninja-build eigen3-devel doctest-devel pugixml-devel json-devel cli11-devel ceres-solver-devel NLopt-devel google-benchmark-devel bullet-devel ode-devel
  Arch:     gcc cmake ninja eigen doctest pugixml nlohmann-json cli11 ceres-solver nlopt benchmark bullet ode
  Homebrew: cmake ninja eigen doctest pugixml nlohmann-json cli11 ceres-solver nlopt google-benchmark bullet ode dartsim
  vcpkg:    eigen3 doctest pugixml nlohmann-json cli11 ceres nlopt benchmark bullet3 ode dartsim
MuJoCo, which is optional, is at https://github.com/google-deepmind/mujoco/releases, DART, optional too, at
https://dartsim.github.io.
END
  exit 1
fi

lacking() {
  for package in "$@"; do
    case $(dpkg-query -W -f='${Status}' "$package" 2>/dev/null) in
      "install ok installed") ;;
      *) printf '%s ' "$package" ;;
    esac
  done
}

# shellcheck disable=SC2086 # the lists are split on purpose, here and below
wanted=$(lacking $required $optional)
if [ -z "$wanted" ]; then
  echo "All dependencies are installed."
  exit 0
fi

if [ "$(id -u)" -eq 0 ]; then
  as_root=
elif command -v sudo >/dev/null; then
  as_root=sudo
else
  echo "Lacking $wanted: run this as root, or install sudo." >&2
  exit 1
fi

$as_root apt-get update
wanted=$(lacking $required)
for package in $(lacking $optional); do
  if apt-cache show "$package" >/dev/null 2>&1; then
    wanted="$wanted $package"
  else
    echo "This system does not offer $package; what rests on it will be left out." >&2
  fi
done
if [ -n "$wanted" ]; then
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -o DPkg::Lock::Timeout=60 -y --no-install-recommends $wanted
fi

version=$(cmake --version | sed -n 's/^cmake version \([0-9]*\)\.\([0-9]*\).*/\1 \2/p')
if [ "${version% *}" -lt 3 ] || { [ "${version% *}" -eq 3 ] && [ "${version#* }" -lt 25 ]; }; then
  echo "traceur needs CMake 3.25 or newer; this system has $(cmake --version | head -n 1)." >&2
  exit 1
fi
