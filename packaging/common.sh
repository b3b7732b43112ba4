# Shared by packaging/run and packaging/test: sourced, not run.
# Sets `root` (the checkout), `build_dir`, `jobs`, and defines say, die, install_dependencies, configure, build.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
build_dir=${PATINA_BUILD_DIR:-$root/build/release}
jobs=${PATINA_JOBS:-$(nproc 2>/dev/null || echo 2)}
started=$SECONDS

say() { printf '\n== %s\n' "$*"; }
die() {
  printf '\n%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 1
}

# Runs a command; on failure says which step failed and leaves with the command's own status.
step() {
  local what=$1
  shift
  "$@" || {
    local status=$?
    printf '\n%s: %s failed with status %d, after %d s.\n' "$(basename "$0")" "$what" "$status" $((SECONDS - started)) >&2
    exit "$status"
  }
}

install_dependencies() {
  say "Dependencies"
  step "installing the dependencies" "$root/packaging/install-dependencies"
}

# configure [CMAKE ARGUMENT...]: nothing to do where the build folder is up to date; the build re-checks CMakeLists itself.
configure() {
  # A build folder made elsewhere (copied or moved checkout) can't be reused.
  if [ -f "$build_dir/CMakeCache.txt" ] && ! grep -qxF "CMAKE_HOME_DIRECTORY:INTERNAL=$root" "$build_dir/CMakeCache.txt"; then
    die "$build_dir was configured for another checkout. Remove it, or name another with PATINA_BUILD_DIR."
  fi
  if [ -f "$build_dir/build.ninja" ] && [ $# -eq 0 ]; then
    say "Configured already in $build_dir"
    return
  fi
  say "Configuring a release build in $build_dir"
  step "configuring" cmake -S "$root" -B "$build_dir" -G Ninja -DCMAKE_BUILD_TYPE=Release "$@"
}

# build [TARGET...]
build() {
  say "Building ${*:-everything} with $jobs jobs (the first time takes some minutes)"
  if [ $# -gt 0 ]; then
    step "building" cmake --build "$build_dir" --parallel "$jobs" --target "$@"
  else
    step "building" cmake --build "$build_dir" --parallel "$jobs"
  fi
}
