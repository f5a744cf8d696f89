#!/usr/bin/env bash
# Bevy's picture with the library, the package in integrations/bevy.
# Usage: scripts/bevy.sh [test [ARGUMENTS of cargo test] | show [ARGUMENTS of the example show]]
#
# test    (or nothing) draws a scene without a window and compares it with kept pictures; the driver is the one that the
#         environment names, or a software driver, so that pictures compare
# show    draws the library's scenes in a window, or into files: show --headless DIR
#
# Bevy asks for a newer Rust than the library. Where the machine's is older a compiler is downloaded from Debian into a folder of
# its own, 200 MB, which changes nothing of the machine. Exit 77: there is none to be had.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"
# shellcheck source=scripts/debian.sh
. "$root/scripts/debian.sh"
# shellcheck source=scripts/rust_forky.sh
. "$root/scripts/rust_forky.sh"

MANIFEST=$root/integrations/bevy/Cargo.toml
NEEDED=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' "$MANIFEST")

none() { say "no Rust $NEEDED: $*"; exit 77; }

is_enough() { [ "$(printf '%s\n' "$NEEDED" "$version" | sort --version-sort | head -n 1)" = "$NEEDED" ]; }

# Sets `version` to what it found.
ensure_compiler() {
  version=$(rustc --version | cut -d ' ' -f 2)
  if is_enough; then
    say "compiler: $(rustc --version)"
    return
  fi
  use_rust_of_forky
  version=$("$RUSTC" --version | cut -d ' ' -f 2)
  if ! is_enough; then
    say "that is older than $NEEDED: looking whether Debian has a newer one by now"
    rm -f "$CACHE/rust-$SUITE/complete"
    use_rust_of_forky
    version=$("$RUSTC" --version | cut -d ' ' -f 2)
    is_enough || none "Debian's $SUITE has $version"
  fi
}

ensure_rust
case ${1:-test} in
  test)
    ensure_compiler
    if [ -z "${VK_DRIVER_FILES:-}" ]; then
      VK_DRIVER_FILES=$(ensure_lavapipe)
      export VK_DRIVER_FILES
    fi
    ensure_vulkan
    # By clippy's compiler, which compiles as the other does, so that what Bevy needs is compiled once. Another version's warns of
    # what this code was never shown to.
    deny=
    if [ "$version" = "$NEEDED" ]; then deny="-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__"; fi
    RUSTC_WORKSPACE_WRAPPER=clippy-driver CLIPPY_ARGS=$deny \
      cargo test --manifest-path "$MANIFEST" --locked --lib --tests --example show "${@:2}"
    ;;
  show)
    ensure_compiler
    ensure_vulkan
    features=(--features window)
    case " $* " in *" --headless "*) features=() ;; esac
    cargo run --manifest-path "$MANIFEST" --locked --release --example show "${features[@]}" -- "${@:2}"
    ;;
  *) fail "$1 is neither test nor show" ;;
esac
