#!/bin/sh
# Runs a test where there is a display; makes a virtual one where there is none. Listing tests needs none.
case "$*" in *--gtest_list_tests*) exec "$@" ;; esac
if [ -n "$DISPLAY" ]; then exec "$@"; fi
exec xvfb-run -a -s "-screen 0 2560x1440x24" "$@"
