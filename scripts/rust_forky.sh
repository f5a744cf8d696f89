# shellcheck shell=bash
# A newer Rust than the machine's, from Debian: 1.97 and its clippy, with libraries for this machine and for browsers, 200 MB in
# a folder of their own. Nothing of the machine changes. Source it, after vulkan.sh and debian.sh.

SUITE=forky # of Debian
CACHE=${XDG_CACHE_HOME:-$HOME/.cache}/deep-screen-space

# Downloads it, unless it is there, and has cargo use it. Calls `none` with the reason where it cannot be had.
use_rust_of_forky() {
  local folder=$CACHE/rust-$SUITE program
  unpack_from_debian "$SUITE" "$folder" "gcc binutils libc-dev" rustc rust-clippy libstd-rust-dev libstd-rust-dev-wasm32
  # Other targets' libraries are half of it.
  rm -rf "$folder"/usr/lib/rustlib/wasm32-wasip*
  # The folder's own loader and C library run them; cargo wants one program of each.
  for program in rustc clippy-driver; do
    cat >"$folder/$program" <<PROGRAM
#!/bin/sh
exec $(find "$folder/usr" -name 'ld-linux*.so.*' -print -quit) \
  --library-path $(dirname "$(find "$folder/usr/lib" -name 'libLLVM*.so*' -print -quit)"):$folder/usr/lib \
  $folder/usr/bin/$program "\$@"
PROGRAM
    chmod +x "$folder/$program"
  done
  export RUSTC=$folder/rustc PATH=$folder:$PATH
  say "compiler: $("$RUSTC" --version)"
}
