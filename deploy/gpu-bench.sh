#!/usr/bin/env bash
# What lexsplat does on a GPU, in about ten minutes once it is built: the engine's bench, forward and backward
# pass beside gsplat's on one scene, and frames per second end to end at 1200x680 with everything on.
#
#   deploy/gpu-bench.sh [--small] [FOLDER]
#
# FOLDER (gpu-bench-out) gets the output as report.txt, and what the parts wrote. --small takes a few
# minutes on a software driver: small scenes, the build of `make test`. It shows that the script works, not
# how fast a GPU is.
set -euo pipefail
cd "$(dirname "$0")/.."
export NODEVICE_SELECT=1 # Mesa's device selection layer complains where there is no display

GSPLAT_VERSION=1.5.3
small=0
if [ "${1:-}" = --small ]; then
  small=1
  shift
fi
case "${1:-}" in -*) echo "error: unknown option $1; usage: deploy/gpu-bench.sh [--small] [FOLDER]" >&2; exit 2 ;; esac
out=$(realpath -m "${1:-gpu-bench-out}")
mkdir -p "$out"

if [ $small = 1 ]; then
  profile=dev programs=target/debug sections=(tracking exchange) scene=20000,300,170
  frames=12 width=320 height=240
else
  profile=release programs=target/release sections=() scene=500000,1200,680
  frames=150 width=1200 height=680
fi

title() { printf '\n== %s\n' "$*"; }
skipped() { echo "SKIPPED: $*"; }

engine() {
  title "the engine's bench"
  EXCHANGE=$out/scene EXCHANGE_SCENE=$scene \
    cargo bench --quiet --profile $profile --workspace --bench engine -- "${sections[@]}"
}

gsplat() {
  title "gsplat $GSPLAT_VERSION on the scene of the section 'one scene'"
  if ! command -v nvidia-smi >/dev/null || ! command -v nvcc >/dev/null; then
    skipped "gsplat needs an NVIDIA GPU (nvidia-smi) and the CUDA compiler (nvcc)"
  elif [ ! -x .deps/gsplat/bin/python ] && ! {
    python3 -m venv .deps/gsplat.partial &&
      .deps/gsplat.partial/bin/pip install --quiet torch numpy ninja "gsplat==$GSPLAT_VERSION" &&
      rm -rf .deps/gsplat && mv .deps/gsplat.partial .deps/gsplat
  }; then
    skipped "gsplat could not be installed, see above"
  else
    .deps/gsplat/bin/python gpu/benches/engine/gsplat.py "$out/scene" || skipped "gsplat failed, see above"
  fi
}

# Everything on: estimated poses, loops closed, language of each keyframe, questions; all steps done before
# the next frame, at the camera's full width.
end_to_end() {
  title "end to end, $frames frames of ${width}x$height"
  "$programs/lexsplat" synth --frames $frames --width $width --height $height "$out/room"
  LEXSPLAT__MAPPER__CLOCK=per_frame LEXSPLAT__MAPPER__TRAIN_WIDTH=$width LEXSPLAT__CLOSURE__ENABLED=true \
    "$programs/lexsplat" evaluate --dataset "replica:$out/room" --poses estimate --language --out "$out/evaluation"
}

deploy/setup.sh
echo 'building: minutes the first time'
cargo build --quiet --profile $profile --workspace --bins
{
  title 'machine'
  uname -srm
  command -v nvidia-smi >/dev/null && nvidia-smi --query-gpu=name,driver_version --format=csv,noheader
  "$programs/lexsplat-server" --adapters
  engine
  gsplat
  end_to_end
} 2>&1 | tee "$out/report.txt"
echo "report: $out/report.txt"
