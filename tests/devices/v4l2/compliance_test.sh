#!/bin/sh
# The fake driver, looked at by programs that we didn't write: usage compliance_test.sh LIBRARY
command -v v4l2-compliance > /dev/null || { echo "SKIPPED: v4l2-compliance is not installed"; exit 77; }
frames=$(mktemp)
run() { LD_PRELOAD="$library" "$@" < /dev/null; }
library="$1"
report=$(run v4l2-compliance -d /dev/video90 -s 2>&1 | tr '\r' '\n')
echo "$report" | grep -E 'fail:|FAIL|Total'
echo "$report" | grep -q 'Total.*Failed: 0' || { echo "v4l2-compliance found failures"; exit 1; }
run v4l2-ctl -d /dev/video90 --list-ctrls | grep -q exposure || { echo "v4l2-ctl sees no exposure control"; exit 1; }
run v4l2-ctl -d /dev/video90 --set-fmt-video=width=128,height=96,pixelformat=RG10 --stream-mmap --stream-count=5 \
  --stream-to="$frames" > /dev/null 2>&1
size=$(wc -c < "$frames")
rm -f "$frames"
[ "$size" -eq $((5 * 128 * 96 * 2)) ] || { echo "v4l2-ctl got $size bytes of 5 frames"; exit 1; }
echo "accepted"
