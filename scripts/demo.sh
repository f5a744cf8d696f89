#!/usr/bin/env bash
# Renders the demo into target/demo, on the machine's GPU or, where it has none, on a software driver that this installs.
# Usage: scripts/demo.sh [ARGUMENTS of the example `render`]
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

ensure_rust
ensure_vulkan
out=$root/target/demo
cargo run --release --manifest-path "$root/Cargo.toml" --example render -- --out "$out" "$@"

pictures=$(find "$out" -name '*.png' 2>/dev/null | sort)
[ -n "$pictures" ] || fail "the run ended well, but there is no picture in $out"
printf 'Rendered:\n%s\n' "$pictures"
