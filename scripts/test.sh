#!/usr/bin/env bash
# Runs the tests, on the machine's GPU or, where it has none, on a software driver that this installs.
# Usage: scripts/test.sh [ARGUMENTS of cargo test]
#
# The dev profile is an optimised one (see Cargo.toml), so there is no need of --release.
# VK_DRIVER_FILES=/path/to/icd.json picks the driver. DSS_LIMITS=default asks the device for the portable floor, wgpu's
# Limits::default() and no features; DSS_LIMITS=all asks for everything that the adapter offers.
set -euo pipefail
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck source=scripts/vulkan.sh
. "$root/scripts/vulkan.sh"

ensure_rust
ensure_vulkan
cargo test --manifest-path "$root/Cargo.toml" "$@"
