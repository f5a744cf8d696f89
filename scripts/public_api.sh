#!/usr/bin/env bash
# Compares what the crate has public, with all features, with the record of it, docs/public-api.txt: no change of it goes unseen.
# Usage: scripts/public_api.sh [--write]
#
# --write renews the record, for a commit that means the change. What is listed is rustdoc's JSON, which is unstable: each Rust
# has a format and a spelling of its own, so the record is that of one Rust. Exit 77: it is another one that is here.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

RUST=1.95 # whose JSON the version of `public-api` in scripts/public_api/Cargo.toml reads
RECORD=docs/public-api.txt
TARGET=${CARGO_TARGET_DIR:-$root/target}

cd -- "$root"
ensure_rust
case $(rustc --version) in
  "rustc $RUST."*) ;;
  *)
    say "$RECORD is by Rust $RUST, which RUSTUP_TOOLCHAIN may name; with $(rustc --version) it is not compared"
    exit 77
    ;;
esac

sources=$(cat scripts/public_api/{main.rs,Cargo.lock} | cksum | cut -d ' ' -f 1)
tool=${XDG_CACHE_HOME:-$HOME/.cache}/deep-screen-space/public-api-$sources
if [ ! -x "$tool/bin/public_api" ]; then
  say "building scripts/public_api"
  env CARGO_INCREMENTAL=0 cargo install --quiet --debug --locked --path scripts/public_api --root "$tool" \
    --target-dir "$TARGET/public_api"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Only rustdoc is told that unstable options are meant: build scripts ask for the same word, and all would be compiled again.
rustdoc=$TARGET/public_api/rustdoc
mkdir -p "${rustdoc%/*}"
printf '#!/bin/sh\nRUSTC_BOOTSTRAP=1 exec rustdoc "$@"\n' >"$rustdoc"
chmod +x "$rustdoc"
# Of the whole workspace, as .ci/run documents it: the dependencies have then been checked with the features that it asks for.
env RUSTDOC="$rustdoc" RUSTDOCFLAGS="-Z unstable-options --output-format json" \
  cargo doc --quiet --locked --workspace --no-deps --all-features --lib
"$tool/bin/public_api" "$TARGET/doc/deep_screen_space.json" >"$work/found"

if [ "${1:-}" = --write ]; then
  cp "$work/found" "$RECORD"
elif ! diff --unified=0 "$RECORD" "$work/found"; then
  fail "the public API is not what $RECORD says: where the change is meant, commit what scripts/public_api.sh --write writes"
fi
say "$(wc -l <"$work/found") public items are those of $RECORD"
