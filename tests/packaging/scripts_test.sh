#!/usr/bin/env bash
# The packaging scripts, with apt-get, dpkg-query, apt-cache and sudo played by small scripts that write down what they were asked.
# Usage: scripts_test.sh SOURCE_DIR
set -uo pipefail
packaging=$1/packaging
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
failures=0

# check WHAT COMMAND...: the command must succeed
check() {
  local what=$1
  shift
  if "$@"; then printf 'ok    %s\n' "$what"; else
    printf 'FAIL  %s\n' "$what"
    sed 's/^/      | /' "$scratch/output" "$scratch/calls" 2>/dev/null
    failures=$((failures + 1))
  fi
}
says() { grep -qF -- "$1" "$scratch/output"; }
called() { grep -qF -- "$1" "$scratch/calls"; }
called_nothing() { [ ! -s "$scratch/calls" ]; }
status_is() { [ "$status" = "$1" ]; }
not() { ! "$@"; }

# A world in which `present` is installed and `known` can be; everything else of the real system stays in reach.
fakes=$scratch/bin
mkdir -p "$fakes"
printf '#!/bin/sh\nfor name in $PRESENT; do echo "installed $name"; done\n' >"$fakes/dpkg-query"
cat >"$fakes/apt-cache" <<'FAKE'
#!/bin/sh
verb=$1; shift
[ "$verb" = policy ] || { [ -e "$SCRATCH/updated" ] && echo "Package: x"; exit 0; }
for name; do
  case " $KNOWN $([ -e "$SCRATCH/updated" ] && echo "$KNOWN_AFTER_UPDATE") " in
    *" $name "*) printf '%s:\n  Installed: (none)\n  Candidate: 1.0\n' "$name" ;;
  esac
done
FAKE
cat >"$fakes/apt-get" <<'FAKE'
#!/bin/sh
case " $* " in *" --print-uris "*) echo "'http://x/alpha.deb' alpha.deb 12000000 MD5Sum:0"; exit 0 ;; esac
echo "apt-get $*" >>"$SCRATCH/calls"
case " $* " in
  *" update "*) touch "$SCRATCH/updated" ;;
  *" install "*) [ -z "$APT_FAILS_UNTIL_UPDATE" ] || [ -e "$SCRATCH/updated" ] || exit 100; [ -z "$APT_FAILS" ] || exit 100 ;;
esac
FAKE
cat >"$fakes/sudo" <<'FAKE'
#!/bin/sh
if [ "$1" = -n ]; then [ -z "$SUDO_WANTS_PASSWORD" ]; exit; fi
echo "sudo $*" >>"$SCRATCH/calls"
exec "$@"
FAKE
printf '#!/bin/sh\necho "$FAKE_UID"\n' >"$fakes/id"
chmod +x "$fakes"/*
printf '# a comment\nalpha  # why\nbeta | gamma\ndelta ?\n' >"$scratch/list"

# world [VARIABLE=VALUE...] -- ARGUMENT...: runs install-dependencies in it
world() {
  local settings=()
  while [ "$1" != -- ]; do settings+=("$1"); shift; done
  shift
  rm -f "$scratch/updated"
  : >"$scratch/calls"
  env -u CI SCRATCH="$scratch" PATH="$fakes:$PATH" PATINA_DEPENDENCIES="$scratch/list" FAKE_UID=1000 PRESENT= KNOWN= KNOWN_AFTER_UPDATE= \
    "${settings[@]}" "$packaging/install-dependencies" "$@" >"$scratch/output" 2>&1 </dev/null
  status=$?
}

world PRESENT="alpha gamma delta" --
check "all there: status 0" status_is 0
check "all there: calls nothing" called_nothing

world PRESENT="alpha" KNOWN="beta delta" -- --dry-run
check "dry run: says what is missing" says "Missing: beta|gamma delta"
check "dry run: status 1" status_is 1
check "dry run: calls nothing" called_nothing

world FAKE_UID=0 KNOWN="alpha gamma delta" --
check "root: status 0" status_is 0
check "root: installs without questions or recommendations" called "install -y --no-install-recommends -qq alpha gamma delta"
check "root: does not use sudo" not called "sudo"
check "root: fetches no lists when all is known" not called "update"

world FAKE_UID=0 PRESENT="beta" KNOWN="alpha" --
check "optional package unknown: left out" called "-qq alpha"
check "optional package unknown: status 0" status_is 0

world FAKE_UID=0 KNOWN_AFTER_UPDATE="alpha beta delta" --
check "no lists yet: fetches them first" called "update"
check "no lists yet: then installs" called "-qq alpha beta delta"

world FAKE_UID=0 KNOWN="alpha" --
check "required package unknown: status 1" status_is 1
check "required package unknown: named" says "has no package beta|gamma"
check "required package unknown: installs nothing" not called "install -y"

world FAKE_UID=0 KNOWN="alpha beta delta" APT_FAILS_UNTIL_UPDATE=1 --
check "old lists: updates and tries again" status_is 0
world FAKE_UID=0 KNOWN="alpha beta delta" APT_FAILS=1 --
check "apt-get fails: status 1" status_is 1

world KNOWN="alpha beta delta" --
check "user, nobody to ask, sudo free: installs through sudo" called "sudo env DEBIAN_FRONTEND=noninteractive apt-get"
world KNOWN="alpha beta delta" SUDO_WANTS_PASSWORD=1 --
check "user, nobody to ask, sudo wants a password: status 1" status_is 1
check "user, nobody to ask, sudo wants a password: prints the command" says "apt-get install --no-install-recommends alpha beta delta"
check "user, nobody to ask, sudo wants a password: calls nothing" called_nothing

# With a terminal: the question decides. `script` gives one.
if command -v script >/dev/null; then
  ask() {
    : >"$scratch/calls"
    rm -f "$scratch/updated"
    printf '%s\n' "$1" | env -u CI SCRATCH="$scratch" PATH="$fakes:$PATH" PATINA_DEPENDENCIES="$scratch/list" FAKE_UID=1000 PRESENT= \
      KNOWN="alpha beta delta" script -qec "$packaging/install-dependencies" /dev/null >"$scratch/output" 2>&1
    status=$?
  }
  ask n
  check "user at a terminal: is asked" says "Install them with"
  check "user at a terminal: hears the size" says "(12 MB to fetch)"
  check "user says no: status 1" status_is 1
  check "user says no: calls nothing" called_nothing
  ask y
  check "user says yes: installs through sudo" called "sudo env"
  check "user says yes: status 0" status_is 0
fi

for script in run test install-dependencies; do
  "$packaging/$script" --help >"$scratch/output" 2>&1 </dev/null
  status=$?
  check "$script --help: status 0" status_is 0
  check "$script --help: shows the usage" says "Usage: packaging/$script"
  "$packaging/$script" --no-such-option >"$scratch/output" 2>&1 </dev/null
  status=$?
  check "$script --no-such-option: status 2" status_is 2
  check "$script: is valid bash" bash -n "$packaging/$script"
done

# A build folder of another checkout is refused with a way on, before anything is built.
mkdir -p "$scratch/foreign"
echo "CMAKE_HOME_DIRECTORY:INTERNAL=/elsewhere" >"$scratch/foreign/CMakeCache.txt"
PATINA_BUILD_DIR=$scratch/foreign "$packaging/test" --no-install >"$scratch/output" 2>&1 </dev/null
status=$?
check "another checkout's build folder: status 1" status_is 1
check "another checkout's build folder: says what to do" says "PATINA_BUILD_DIR"

# The builds themselves, with cmake, ctest and patina-cli played too.
root=$(cd "$packaging/.." && pwd -P)
mkdir -p "$scratch/tools" "$scratch/build/bin"
printf '#!/bin/sh\necho "cmake $*" >>"$SCRATCH/calls"\n' >"$scratch/tools/cmake"
printf '#!/bin/sh\necho "ctest $*" >>"$SCRATCH/calls"\n' >"$scratch/tools/ctest"
cat >"$scratch/build/bin/patina-cli" <<'FAKE'
#!/bin/sh
while [ $# -gt 0 ]; do
  case $1 in
    --out) mkdir -p "$2/maps"; : >"$2/maps/diffuse.exr" ;;
    --dump-dir) mkdir -p "$2"; : >"$2/diffuse.png" ;;
  esac
  shift
done
FAKE
chmod +x "$scratch"/tools/* "$scratch/build/bin/patina-cli"
# built CACHE_LINE -- SCRIPT ARGUMENT...: runs a script on a build folder that is configured already
built() {
  printf 'CMAKE_HOME_DIRECTORY:INTERNAL=%s\n%s\n' "$root" "$1" >"$scratch/build/CMakeCache.txt"
  : >"$scratch/build/build.ninja"
  : >"$scratch/calls"
  env SCRATCH="$scratch" PATH="$scratch/tools:$PATH" PATINA_BUILD_DIR="$scratch/build" PATINA_OUT="$scratch/out" \
    "$packaging/$3" "${@:4}" >"$scratch/output" 2>&1 </dev/null
  status=$?
}

built "" -- test --no-install --strict
check "strict: warnings are errors" called "-DPATINA_WARNINGS_AS_ERRORS=ON"
built "PATINA_WARNINGS_AS_ERRORS:BOOL=ON" -- test --no-install
check "not strict any more: says so to cmake" called "-DPATINA_WARNINGS_AS_ERRORS=OFF"
check "not strict any more: runs the tests" called "ctest --test-dir"
built "PATINA_WARNINGS_AS_ERRORS:BOOL=OFF" -- test --no-install
check "never strict: does not configure again" not called "-DPATINA_WARNINGS_AS_ERRORS"

built "" -- run --no-install --headless some/bundle
check "headless with a bundle: status 0" status_is 0
check "headless with a bundle: names the maps" says "$scratch/out/bundle/maps/diffuse.exr"
check "headless with a bundle: names a picture" says "$scratch/out/bundle/stages/diffuse.png"

# Nothing on the list may be there twice, and the names must be names.
names=$(sed -e 's/#.*//' "$packaging/dependencies" | awk 'NF { print $1 }')
check "the list names packages" test "$(wc -l <<<"$names")" -ge 15
check "no package twice" test -z "$(sort <<<"$names" | uniq -d)"
check "package names only" not grep -qvE '^[a-z0-9][a-z0-9.+-]+$' <<<"$names"

[ "$failures" = 0 ] && echo "All passed." || { echo "$failures failed."; exit 1; }
