#!/usr/bin/env bash
# Tests the viewer in a window of its own: on the display that there is, or on an X server without a screen, which this installs.
# Usage: scripts/viewer.sh [ARGUMENTS of cargo test]
#
# The driver is the one that the environment names, or a software driver, so that pictures compare.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

ensure_rust
if [ -z "${VK_DRIVER_FILES:-}" ]; then
  VK_DRIVER_FILES=$(ensure_lavapipe)
  export VK_DRIVER_FILES
fi
ensure_vulkan
ensure_xvfb
folder=$(mktemp -d)
# A server of its own, whose number it chooses, so that runs beside each other do not meet.
Xvfb -displayfd 3 -screen 0 1400x1000x24 -nolisten tcp 3>"$folder/display" 2>"$folder/log" &
server=$!
trap 'kill "$server" 2>/dev/null || true; rm -rf "$folder"' EXIT
for _ in $(seq 100); do
  [ -s "$folder/display" ] && break
  kill -0 "$server" 2>/dev/null || { cat "$folder/log" >&2; fail "the X server ended"; }
  sleep 0.1
done
[ -s "$folder/display" ] || fail "the X server does not start"
DISPLAY=:$(cat "$folder/display")
export DISPLAY
unset WAYLAND_DISPLAY
# Its arithmetic is the crate's and the support's: to optimise what is left, the window and its text, would take longer than it
# saves.
unoptimised=()
for package in deep-screen-space-viewer accesskit arboard egui egui-winit epaint fearless_simd font-types harfrust kurbo peniko \
  read-fonts rustix skrifa vello_common vello_cpu winit x11rb x11rb-protocol; do
  unoptimised+=(--config "profile.dev.package.$package.opt-level=0")
done
cargo test "${unoptimised[@]}" --manifest-path "$root/Cargo.toml" \
  --package deep-screen-space-viewer --no-default-features --features x11 "$@"
