#!/usr/bin/env bash
# A Crazyflie's radio traffic in the library of its makers: `tests/readers/crazyflie.sh RECORDING`, of the scenario
# `crazyflie-hover`.
set -euo pipefail
recording=$(realpath "${1:?usage: tests/readers/crazyflie.sh RECORDING}")
cd "$(dirname "$0")/../.."
venv=target/readers-crazyflie
if ! "$venv/bin/python" -c 'import cflib, mcap_ros1' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r tests/readers/crazyflie.txt
fi
"$venv/bin/python" tests/readers/crazyflie.py "$recording"
