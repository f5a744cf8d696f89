#!/usr/bin/env bash
# Runs the tests of rays that the device traces (tests/ray_query), on a software driver that has such rays.
# Usage: scripts/ray_query.sh [--times] [ARGUMENTS of the test program]
#
# The driver is lavapipe of Mesa 24.2 or newer, which older distributions do not have. On Debian it is downloaded from the next
# release, with all that it needs down to the C library, into a folder of its own: nothing of the machine changes, and the tests
# are run by that folder's loader. Elsewhere VK_DRIVER_FILES names the driver, and nothing is downloaded.
# --times prints what the device takes over what the crate takes, and tests nothing. Exit 77: there is no such driver to be had.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

SUITE=trixie # of Debian, with Mesa 25.0
FOLDER=${XDG_CACHE_HOME:-$HOME/.cache}/deep-screen-space/lavapipe-$SUITE

none() { say "no driver with ray queries: $*"; exit 77; }

# The machine's own sources of Debian, for another suite.
sources() {
  local codename=$1 file
  for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
    [ -r "$file" ] || continue
    awk -v of="$codename" -v suite="$SUITE" '/^deb / { for (i = 2; i <= NF; i++) if ($i == of) { $i = suite; print; next } }' \
      "$file" >>"$2/own.list"
  done
  for file in /etc/apt/sources.list.d/*.sources; do
    [ -r "$file" ] || continue
    awk -v of="$codename" -v suite="$SUITE" 'BEGIN { RS = ""; ORS = "\n\n" }
      $0 ~ "\nSuites:[^\n]* " of "( |\n|$)" { sub(/\nSuites:[^\n]*/, "\nSuites: " suite); print }' "$file" >>"$2/own.sources"
  done
}

# Downloads and unpacks the driver, unless it is there.
fetch() {
  [ -e "$FOLDER/complete" ] && return
  command -v apt-get >/dev/null && command -v dpkg >/dev/null || none "there is no apt-get here; VK_DRIVER_FILES may name one"
  # shellcheck disable=SC1091 # every system has it
  local codename work log
  codename=$(. /etc/os-release && printf '%s' "${VERSION_CODENAME:-}")
  work=$(mktemp -d)
  log=$work/log
  mkdir -p "$work"/{lists/partial,archives/partial,parts,root}
  touch "$work/status"
  sources "$codename" "$work/parts"
  cat >"$work/apt.conf" <<CONF
Dir::State "$work";
Dir::State::lists "$work/lists";
Dir::State::status "$work/status";
Dir::Cache "$work";
Dir::Cache::archives "$work/archives";
Dir::Etc::sourcelist "/dev/null";
Dir::Etc::sourceparts "$work/parts";
Dir::Etc::preferences "/dev/null";
Dir::Etc::preferencesparts "/dev/null";
APT::Sandbox::User "$(id -un)";
Acquire::Languages "none";
Acquire::IndexTargets::deb::DEP-11::DefaultEnabled "false";
CONF
  say "downloading lavapipe of Debian's $SUITE"
  # As if nothing were installed: all that the driver needs comes along.
  if ! { timeout 100 apt-get -c "$work/apt.conf" -q update &&
    timeout 100 apt-get -c "$work/apt.conf" -q -y --no-install-recommends --download-only install mesa-vulkan-drivers libvulkan1 &&
    for file in "$work"/archives/*.deb; do dpkg -x "$file" "$work/root"; done; } </dev/null >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    rm -rf "$work"
    none "Debian's $SUITE could not be had (the last lines are above)"
  fi
  rm -rf "$FOLDER"
  mkdir -p "$FOLDER"
  mv "$work/root/usr" "$FOLDER/usr"
  rm -rf "$work"
  touch "$FOLDER/complete"
}

ensure_rust
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-${TMPDIR:-/tmp}}
runner=()
if [ -n "${VK_DRIVER_FILES:-}" ]; then
  say "Vulkan driver named by the environment: $VK_DRIVER_FILES"
else
  fetch
  VK_DRIVER_FILES=$(find "$FOLDER/usr/share/vulkan/icd.d" -name 'lvp_icd*.json' -print -quit)
  loader=$(find "$FOLDER/usr" -name 'ld-linux*.so.*' -print -quit)
  libraries=$(dirname "$(find "$FOLDER/usr/lib" -name libvulkan_lvp.so -print -quit)")
  export VK_DRIVER_FILES
  say "Vulkan driver: $VK_DRIVER_FILES"
  runner=(--config "target.'cfg(all())'.runner = ['$loader', '--library-path', '$libraries']")
fi
arguments=("$@")
[ "${1:-}" != --times ] || arguments=(--ignored --nocapture "${@:2}")
cargo "${runner[@]}" test --locked --manifest-path "$root/Cargo.toml" --package deep-screen-space-ray-query -- "${arguments[@]}"
