#!/usr/bin/env bash
# Tests the viewer in a window of its own: on an X server without a screen, or a Wayland compositor without one, which this
# installs.
# Usage: scripts/viewer.sh [--wayland] [ARGUMENTS of cargo test]
#
# The driver is the one that the environment names, or a software driver, so that pictures compare. SwiftShader shows windows on
# Wayland alone.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

system=x11
if [ "${1:-}" = --wayland ]; then
  system=wayland
  shift
fi
ensure_rust
if [ -z "${VK_DRIVER_FILES:-}" ]; then
  VK_DRIVER_FILES=$(ensure_lavapipe)
  export VK_DRIVER_FILES
fi
ensure_vulkan
folder=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true; rm -rf "$folder"' EXIT

# Until a command says that the server is ready.
await() {
  for _ in $(seq 100); do
    "$@" && return
    kill -0 "$server" 2>/dev/null || { cat "$folder/log" >&2; fail "the server of windows ended"; }
    sleep 0.1
  done
  fail "the server of windows does not start"
}

unset DISPLAY WAYLAND_DISPLAY
if [ $system = wayland ]; then
  command -v weston >/dev/null || apt_install weston
  export XDG_RUNTIME_DIR=$folder
  # Of no screen, and as large as the tests' windows become.
  weston --backend=headless-backend.so --width=1400 --height=1000 --no-config --idle-time=0 \
    --socket=wayland-of-test >"$folder/log" 2>&1 &
  server=$!
  await test -S "$folder/wayland-of-test"
  export WAYLAND_DISPLAY=wayland-of-test
else
  ensure_xvfb
  # A server of its own, whose number it chooses, so that runs beside each other do not meet.
  Xvfb -displayfd 3 -screen 0 1400x1000x24 -nolisten tcp 3>"$folder/display" 2>"$folder/log" &
  server=$!
  await test -s "$folder/display"
  DISPLAY=:$(cat "$folder/display")
  export DISPLAY
fi
# Its arithmetic is the crate's and the support's: to optimise what is left, the window and its text, would take longer than it
# saves.
unoptimised=()
for package in deep-screen-space-viewer accesskit arboard egui egui-winit epaint fearless_simd font-types harfrust kurbo peniko \
  read-fonts rustix skrifa vello_common vello_cpu winit x11rb x11rb-protocol; do
  unoptimised+=(--config "profile.dev.package.$package.opt-level=0")
done
cargo test "${unoptimised[@]}" --manifest-path "$root/Cargo.toml" \
  --package deep-screen-space-viewer --no-default-features --features "$system" "$@"
