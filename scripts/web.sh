#!/usr/bin/env bash
# Builds the page of examples/web, the crate in a browser, into target/web/page: static files for any web server.
# Usage: scripts/web.sh [serve [PORT] | check]
#
# serve   serves the page to this computer alone, at port 8000 or another
# check   opens it in a headless browser and compares its pictures with those that the tests rendered without one
#         (cargo test --test whole browser); prints the size of the download and a frame's time
#
# Where Rust has no standard library for wasm32-unknown-unknown (rustup target add), a compiler that has one is downloaded from
# Debian into a folder of its own, 200 MB, which changes nothing of the machine. Exit 77: there is none to be had.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"
# shellcheck source=scripts/debian.sh
. "$root/scripts/debian.sh"
# shellcheck source=scripts/rust_forky.sh
. "$root/scripts/rust_forky.sh"

TARGET=wasm32-unknown-unknown
OUT=$root/target/web
PAGE=$OUT/page

none() { say "no Rust for $TARGET: $*"; exit 77; }

# The compiler, and the linker that it is told to use: rustup's compiler brings one, Debian's does not.
ensure_compiler() {
  local own
  own=$(rustc --print sysroot)/lib/rustlib/$(rustc --print host-tuple)/bin/rust-lld
  if [ -d "$(rustc --print target-libdir --target $TARGET)" ]; then
    say "compiler: $(rustc --version)"
    return
  fi
  [ -x "$own" ] || own=$(command -v wasm-ld) || none "there is no wasm-ld on the PATH"
  use_rust_of_forky
  export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=$own
}

# What writes the JavaScript, by this machine's own compiler. Prints its path.
ensure_bindgen() {
  local version folder
  version=$(awk '/^name = "wasm-bindgen"$/ { getline; gsub(/"/, "", $3); print $3 }' "$root/Cargo.lock")
  folder=$CACHE/bindgen-$version-$(cksum <"$root/examples/web/bindgen/main.rs" | cut -d ' ' -f 1)
  if [ ! -x "$folder/bin/bindgen" ]; then
    grep -q "\"=$version\"" "$root/examples/web/bindgen/Cargo.toml" ||
      fail "Cargo.lock has wasm-bindgen $version, and examples/web/bindgen/Cargo.toml another"
    say "building what writes the JavaScript"
    env CARGO_INCREMENTAL=0 cargo install --quiet --debug --locked --path "$root/examples/web/bindgen" --root "$folder" \
      --target-dir "$OUT/bindgen"
  fi
  printf '%s\n' "$folder/bin/bindgen"
}

build() {
  ensure_rust
  local bindgen module=$OUT/$TARGET/web/web.wasm
  bindgen=$(ensure_bindgen)
  ensure_compiler
  # Code that nothing uses here, if not elsewhere, is an error.
  env RUSTFLAGS="-D unused" CARGO_INCREMENTAL=0 cargo rustc --locked --manifest-path "$root/Cargo.toml" \
    --package deep-screen-space-web --lib --crate-type cdylib --profile web --target $TARGET --target-dir "$OUT"
  mkdir -p "$PAGE"
  "$bindgen" "$module" "$PAGE"
  cp "$root/examples/web/index.html" "$PAGE/"
  say "page: $PAGE"
}

case ${1:-} in
  "") build ;;
  serve)
    build
    say "open http://localhost:${2:-8000}/ (Ctrl-C ends it)"
    exec python3 -m http.server --bind 127.0.0.1 --directory "$PAGE" "${2:-8000}"
    ;;
  check)
    build
    exec python3 "$root/scripts/web_check.py" --browser "$(ensure_chromium)" "$PAGE" "$OUT/native"
    ;;
  *) fail "$1 is neither serve nor check" ;;
esac
