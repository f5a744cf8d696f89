# shellcheck shell=bash
# Packages of another suite of Debian in a folder of their own: nothing of the machine changes. Source it, after vulkan.sh.

# sources CODENAME SUITE FOLDER: the machine's own sources of Debian, for another suite.
sources() {
  local codename=$1 suite=$2 file
  for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
    [ -r "$file" ] || continue
    awk -v of="$codename" -v suite="$suite" '/^deb / { for (i = 2; i <= NF; i++) if ($i == of) { $i = suite; print; next } }' \
      "$file" >>"$3/own.list"
  done
  for file in /etc/apt/sources.list.d/*.sources; do
    [ -r "$file" ] || continue
    awk -v of="$codename" -v suite="$suite" 'BEGIN { RS = ""; ORS = "\n\n" }
      $0 ~ "\nSuites:[^\n]* " of "( |\n|$)" { sub(/\nSuites:[^\n]*/, "\nSuites: " suite); print }' "$file" >>"$3/own.sources"
  done
}

# unpack_from_debian SUITE FOLDER PRESENT PACKAGE...: downloads packages with all that they need, down to the C library, and
# unpacks them into FOLDER/usr, unless they are there. What the names in PRESENT (a string of words) bring is the machine's own.
# Calls `none` with the reason where they cannot be had.
unpack_from_debian() {
  local suite=$1 folder=$2 present=$3
  shift 3
  [ "$(cat "$folder/complete" 2>/dev/null || true)" = "$*" ] && return
  command -v apt-get >/dev/null && command -v dpkg >/dev/null || none "there is no apt-get here"
  # shellcheck disable=SC1091 # every system has it
  local codename work log name
  codename=$(. /etc/os-release && printf '%s' "${VERSION_CODENAME:-}")
  work=$(mktemp -d)
  log=$work/log
  mkdir -p "$work"/{lists/partial,archives/partial,parts,root}
  # As if nothing else were installed: all that the packages need comes along.
  for name in $present; do
    printf 'Package: %s\nStatus: install ok installed\nVersion: 999\nArchitecture: %s\nMaintainer: -\nDescription: -\n\n' \
      "$name" "$(dpkg --print-architecture)"
  done >"$work/status"
  sources "$codename" "$suite" "$work/parts"
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
  say "downloading $* of Debian's $suite"
  if ! { timeout 100 apt-get -c "$work/apt.conf" -q update &&
    timeout 100 apt-get -c "$work/apt.conf" -q -y --no-install-recommends --download-only install "$@" &&
    for file in "$work"/archives/*.deb; do dpkg -x "$file" "$work/root"; done; } </dev/null >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    rm -rf "$work"
    none "Debian's $suite could not be had (the last lines are above)"
  fi
  rm -rf "$folder"
  mkdir -p "$folder"
  mv "$work/root/usr" "$folder/usr"
  rm -rf "$work"
  printf '%s' "$*" >"$folder/complete"
}
