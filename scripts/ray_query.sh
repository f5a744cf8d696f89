#!/usr/bin/env bash
# Runs the tests of rays that the device traces (tests/ray_query), on a software driver that has such rays.
# Usage: scripts/ray_query.sh [ARGUMENTS of the test program], or scripts/ray_query.sh --times
#
# The driver is lavapipe of Mesa 24.2 or newer, which older distributions do not have. On Debian it is downloaded from the next
# release, with all that it needs down to the C library, into a folder of its own: nothing of the machine changes, and the tests
# are run by that folder's loader. Elsewhere VK_DRIVER_FILES names the driver, and nothing is downloaded.
# --times runs the package's bench: what the device takes over what the crate takes. Exit 77: no such driver is to be had.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"
# shellcheck source=scripts/debian.sh
. "$root/scripts/debian.sh"

SUITE=trixie # of Debian, with Mesa 25.0
FOLDER=${XDG_CACHE_HOME:-$HOME/.cache}/deep-screen-space/lavapipe-$SUITE

none() { say "no driver with ray queries: $* (VK_DRIVER_FILES may name one)"; exit 77; }

ensure_rust
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-${TMPDIR:-/tmp}}
runner=()
if [ -n "${VK_DRIVER_FILES:-}" ]; then
  say "Vulkan driver named by the environment: $VK_DRIVER_FILES"
else
  unpack_from_debian "$SUITE" "$FOLDER" "" mesa-vulkan-drivers libvulkan1
  VK_DRIVER_FILES=$(find "$FOLDER/usr/share/vulkan/icd.d" -name 'lvp_icd*.json' -print -quit)
  loader=$(find "$FOLDER/usr" -name 'ld-linux*.so.*' -print -quit)
  libraries=$(dirname "$(find "$FOLDER/usr/lib" -name libvulkan_lvp.so -print -quit)")
  export VK_DRIVER_FILES
  say "Vulkan driver: $VK_DRIVER_FILES"
  runner=(--config "target.'cfg(all())'.runner = ['$loader', '--library-path', '$libraries']")
fi
what=(test)
if [ "${1:-}" = --times ]; then
  # By the tests' profile, an optimised one (see Cargo.toml), which is built already.
  what=(bench --profile dev --bench times)
  shift
fi
cargo "${runner[@]}" "${what[@]}" --locked --manifest-path "$root/Cargo.toml" --package deep-screen-space-ray-query -- "$@"
