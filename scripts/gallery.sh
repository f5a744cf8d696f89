#!/usr/bin/env bash
# Draws the pictures of docs/gallery.md by the commands that stand above them there.
set -euo pipefail
cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/vulkan.sh
. scripts/vulkan.sh

ensure_rust
ensure_vulkan
cargo build --release --locked --example render
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
mkdir -p docs/gallery

command=
while IFS= read -r line; do
  case $line in
    '`render '*'`') command=${line#'`render '} && command=${command%'`'} ;;
    '!['*'](gallery/'*'.png)')
      picture=${line##*gallery/} && picture=docs/gallery/${picture%)}
      rm -rf "${out:?}"/*
      printf '%s: ' "$picture"
      # shellcheck disable=SC2086 # The command's words.
      target/release/examples/render $command --out "$out" | tail -1
      cp "$out"/*_compared.png "$picture"
      ;;
  esac
done <docs/gallery.md
