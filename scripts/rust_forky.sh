# shellcheck shell=bash
# A newer Rust than the machine's, from Debian: 1.97 and its clippy, with libraries for this machine and for browsers, 200 MB in
# a folder of their own. Nothing of the machine changes. Source it, after vulkan.sh and debian.sh.

SUITE=forky # of Debian
CACHE=${XDG_CACHE_HOME:-$HOME/.cache}/deep-screen-space

# A word of sh.
quoted() { printf "'%s'" "${1//\'/\'\\\'\'}"; }

# Downloads it, unless it is there, and has cargo use it. Calls `none` with the reason where it cannot be had.
use_rust_of_forky() {
  local folder=$CACHE/rust-$SUITE program loader libraries
  unpack_from_debian "$SUITE" "$folder" "gcc binutils libc-dev" rustc rust-clippy libstd-rust-dev libstd-rust-dev-wasm32
  # Other targets' libraries are half of it.
  rm -rf "$folder"/usr/lib/rustlib/wasm32-wasip*
  # The folder's own loader and C library run them; cargo wants one program of each.
  loader=$(find "$folder/usr" -name 'ld-linux*.so.*' -print -quit)
  libraries=$(find "$folder/usr/lib" -name 'libLLVM*.so*' -print -quit)
  libraries=$(dirname "$libraries"):$folder/usr/lib
  for program in rustc clippy-driver; do
    printf '#!/bin/sh\nexec %s --library-path %s %s "$@"\n' \
      "$(quoted "$loader")" "$(quoted "$libraries")" "$(quoted "$folder/usr/bin/$program")" >"$folder/$program"
    chmod +x "$folder/$program"
  done
  export RUSTC=$folder/rustc PATH=$folder:$PATH
  say "compiler: $("$RUSTC" --version)"
}
