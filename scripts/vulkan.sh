# shellcheck shell=bash
# What the other scripts need of the machine: Rust, a linker, a Vulkan driver, a browser, an X server. Source it; it runs nothing
# by itself.
#
# Whatever is there already is used as it is. What is missing comes from Debian's (or Ubuntu's) packages; anywhere else the
# script says what to install. Each function says in one line, on standard error, what it found or did.

# Where the Vulkan loader looks for the manifest of a driver (its "ICD file").
ICD_DIRS=(/usr/local/share/vulkan/icd.d /etc/vulkan/icd.d /usr/share/vulkan/icd.d)
# SwiftShader, the software driver that a Chromium brings along.
SWIFTSHADER_ICDS=(/usr/lib/chromium/vk_swiftshader_icd.json /usr/lib/chromium-browser/vk_swiftshader_icd.json)
CHROMIUM_NAMES=(chromium chromium-browser google-chrome)

say() { printf '%s: %s\n' "${0##*/}" "$*" >&2; }
fail() { say "error: $*"; exit 1; }

# apt_install PACKAGE...: from the distribution, without questions; its log is shown only where it fails.
apt_install() {
  command -v apt-get >/dev/null || fail "there is no apt-get here: install the equivalent of '$*' by hand, then run this again"
  local as_root=() log
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || fail "neither root nor sudo: have '$*' installed, then run this again"
    as_root=(sudo)
  fi
  say "installing $*"
  log=$(mktemp)
  if ! { "${as_root[@]}" apt-get update -q &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -q -o DPkg::Lock::Timeout=120 --no-install-recommends "$@"; } </dev/null >"$log" 2>&1; then
    tail -n 15 "$log" >&2
    rm -f "$log"
    fail "could not install '$*' (apt-get's last lines are above)"
  fi
  rm -f "$log"
}

# Cargo on the PATH and a C linker, which rustc calls.
ensure_rust() {
  # shellcheck disable=SC1091 # rustup writes it
  if ! command -v cargo >/dev/null && [ -r "${CARGO_HOME:-$HOME/.cargo}/env" ]; then . "${CARGO_HOME:-$HOME/.cargo}/env"; fi
  command -v cargo >/dev/null || fail "no cargo on the PATH: install Rust (the version in Cargo.toml's rust-version, or newer)"
  # gcc only recommends the C library's start files, which linking needs.
  command -v cc >/dev/null || apt_install gcc libc6-dev
}

# The path of lavapipe's manifest, that of this machine's architecture first; nothing where it is not installed.
find_lavapipe() {
  local dir file
  for dir in "${ICD_DIRS[@]}"; do
    for file in "$dir/lvp_icd.$(uname -m).json" "$dir"/lvp_icd*.json; do
      if [ -f "$file" ]; then printf '%s\n' "$file"; return; fi
    done
  done
}

# The path of a hardware driver's manifest, where there is a device node for it; nothing otherwise. Mesa installs the manifests
# of every vendor on every machine, so that the file alone says nothing.
find_hardware_driver() {
  local dir file node
  for dir in "${ICD_DIRS[@]}"; do
    for file in "$dir"/*.json; do
      [ -f "$file" ] || continue
      case "${file##*/}" in
        lvp_* | *swiftshader*) continue ;;
        nvidia*) node=/dev/nvidia0 ;;
        *) node='/dev/dri/renderD*' ;;
      esac
      if compgen -G "$node" >/dev/null; then printf '%s\n' "$file"; return; fi
    done
  done
}

have_loader() {
  local file listed
  listed=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null || true)
  case "$listed" in *libvulkan.so.1*) return 0 ;; esac
  for file in /usr/lib/libvulkan.so.1 /usr/lib64/libvulkan.so.1 /usr/local/lib/libvulkan.so.1; do
    [ -e "$file" ] && return 0
  done
  return 1
}

# Any Vulkan driver: the one that the environment names, else the machine's GPU, else lavapipe, installed if need be.
ensure_vulkan() {
  # Without it every start of a Vulkan driver complains of a window system, which nothing here uses.
  export XDG_RUNTIME_DIR="${XDG_RUNTIME_DIR:-${TMPDIR:-/tmp}}"
  if [ "$(uname -s)" != Linux ]; then say "no Vulkan driver needed: $(uname -s) has a GPU interface of its own"; return; fi
  local driver
  if [ -n "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ]; then
    have_loader || apt_install libvulkan1
    say "Vulkan driver named by the environment: ${VK_DRIVER_FILES:-$VK_ICD_FILENAMES}"
    return
  fi
  driver=$(find_hardware_driver)
  if [ -z "$driver" ]; then driver=$(find_lavapipe); fi
  if [ -z "$driver" ]; then
    apt_install mesa-vulkan-drivers libvulkan1
    driver=$(find_lavapipe)
    [ -n "$driver" ] || fail "mesa-vulkan-drivers is installed, but brought no lavapipe (lvp_icd*.json)"
  elif ! have_loader; then
    apt_install libvulkan1
  fi
  say "Vulkan driver: $driver"
}

# lavapipe, Mesa's software driver, whatever else is there. Prints the path of its manifest.
ensure_lavapipe() {
  if [ -z "$(find_lavapipe)" ] || ! have_loader; then apt_install mesa-vulkan-drivers libvulkan1; fi
  local driver
  driver=$(find_lavapipe)
  [ -n "$driver" ] || fail "mesa-vulkan-drivers is installed, but brought no lavapipe (lvp_icd*.json)"
  say "lavapipe: $driver"
  printf '%s\n' "$driver"
}

find_swiftshader() {
  local file
  for file in "${SWIFTSHADER_ICDS[@]}"; do
    if [ -f "$file" ]; then printf '%s\n' "$file"; return; fi
  done
}

# SwiftShader, Chromium's software driver: a second opinion on every shader. Prints the path of its manifest.
ensure_swiftshader() {
  if [ -z "$(find_swiftshader)" ]; then apt_install chromium; fi
  have_loader || apt_install libvulkan1
  local driver
  driver=$(find_swiftshader)
  [ -n "$driver" ] || fail "chromium is installed, but brought no SwiftShader (vk_swiftshader_icd.json)"
  say "SwiftShader: $driver"
  printf '%s\n' "$driver"
}

find_chromium() {
  local name
  for name in "${CHROMIUM_NAMES[@]}"; do
    if command -v "$name"; then return; fi
  done
}

# A Chromium to ask for its verdict on WGSL. Prints the path of the program.
ensure_chromium() {
  if [ -z "$(find_chromium)" ]; then apt_install chromium; fi
  local browser
  browser=$(find_chromium)
  [ -n "$browser" ] || fail "chromium is installed, but not on the PATH"
  say "Chromium: $browser"
  printf '%s\n' "$browser"
}

# Xvfb, an X server without a screen, and the libraries that a window loads when it opens.
ensure_xvfb() {
  local libraries
  libraries=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null || true)
  case "$libraries" in
    *libXcursor.so.1*libXi.so.6* | *libXi.so.6*libXcursor.so.1*)
      case "$libraries" in *libxkbcommon-x11.so.0*) command -v Xvfb >/dev/null && return ;; esac
      ;;
  esac
  apt_install xvfb libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2 libx11-xcb1
}
