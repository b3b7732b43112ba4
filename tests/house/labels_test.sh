#!/usr/bin/env bash
# Every kind of test can be asked for by its label, also where a test has two, and has its time limit.
# Usage: labels_test.sh BUILD_DIR. Status 77 (skipped): some tests are not built, so their labels are not known.
set -uo pipefail
count() { ctest --test-dir "$1" -N "${@:2}" | sed -n 's/^Total Tests: //p'; }

if ctest --test-dir "$1" -N | grep _NOT_BUILT >/dev/null; then
  echo "Some tests are not built."
  exit 77
fi
failures=0
for label in unit effect device fit fuzz bench; do
  found=$(count "$1" -L "^$label\$")
  printf '%-7s %s tests\n' "$label" "$found"
  [ "${found:-0}" -gt 0 ] || failures=$((failures + 1))
done
limits=$(ctest --test-dir "$1" --show-only=json-v1 -L '^device$' | grep -c '"name" : "TIMEOUT"')
echo "device tests with a time limit: $limits"
[ "$limits" = "$(count "$1" -L '^device$')" ] || failures=$((failures + 1))
[ "$failures" = 0 ] || { echo "$failures failed."; exit 1; }
