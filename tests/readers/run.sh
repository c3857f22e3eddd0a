#!/usr/bin/env bash
# Third-party readers on a recording: `tests/readers/run.sh RECORDING`. Every message of every topic is decoded by
# readers from their registry, in ROS 1's form and after an export in ROS 2's, and every field is compared with what
# `arena echo` says.
set -euo pipefail
recording=$(realpath "${1:?usage: tests/readers/run.sh RECORDING}")
cd "$(dirname "$0")/../.."
venv=target/readers
arena=${ARENA:-target/release/arena}
if ! "$venv/bin/python" -c 'import rosbags, mcap_ros1, mcap_ros2' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r tests/readers/requirements.txt
fi
work=$(mktemp -d target/readers-XXXXXX)
trap 'rm -rf "$work"' EXIT
"$arena" export "$recording" --ros2 --output "$work/ros2.mcap"
"$arena" export "$recording" --json --output "$work/export.json"
mkdir "$work/echo"
"$arena" topics "$recording" --json >"$work/topics.json"
"$venv/bin/python" - "$work/topics.json" <<'PYTHON' >"$work/topics"
import json, sys
for line in open(sys.argv[1]):
    print(json.loads(line)["topic"])
PYTHON
while read -r topic; do
    "$arena" echo "$topic" "$recording" --json
done <"$work/topics" >"$work/echo.json"
"$venv/bin/python" tests/readers/check.py "$recording" "$work/ros2.mcap" "$work/echo.json" "$work/export.json"
# And both radios' bytes by docs/hardware.md alone.
if grep -qx radio/tx "$work/topics"; then
    for topic in radio/tx radio/rx vehicle/command-sent vehicle/telemetry; do
        "$arena" echo "$topic" "$recording" --json >"$work/${topic/\//-}"
    done
    python3 tests/readers/link.py "$work"/radio-tx "$work"/radio-rx "$work"/vehicle-command-sent "$work"/vehicle-telemetry
fi
