#!/usr/bin/env bash
# The device bytes of a recording in packages of the field: `tests/devices/run.sh RECORDING [OF_A_CRAZYFLIE]`. What the
# simulated equipment and the radio bridge put on the wire is decoded by others' decoders, where the package index has
# one, and compared with what `arena echo` says of the same moments; frames that no recording has are compared with
# those that the packages make themselves.
set -euo pipefail
recording=$(realpath "${1:?usage: tests/devices/run.sh RECORDING [OF_A_CRAZYFLIE]}")
crazyflie=${2:+$(realpath "$2")}
cd "$(dirname "$0")/../.."
venv=target/devices
arena=${ARENA:-target/release/arena}
if ! "$venv/bin/python" -c 'import cflib, digi.xbee, rfrx' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps -r tests/devices/requirements.txt
fi
work=$(mktemp -d target/devices-XXXXXX)
trap 'rm -rf "$work"' EXIT
say() {
    for topic in "${@:2}"; do
        "$arena" echo "$topic" "$1" --json
    done
}
say "$recording" vicon/rx mocap/frame radio/rx radio/tx vehicle/telemetry vehicle/command-sent maneuver/upload \
    maneuver/start >"$work/echo.json"
cargo run --quiet --release --locked -p device --example frames >"$work/frames.json"
"$venv/bin/python" tests/devices/check.py "$work/echo.json" "$work/frames.json"
if [ -n "$crazyflie" ]; then
    say "$crazyflie" radio/rx radio/tx vehicle/telemetry vehicle/command-sent >"$work/crazyflie.json"
    "$venv/bin/python" tests/devices/crazyflie.py "$work/crazyflie.json"
fi
