#!/bin/bash
# A wheel of landerd, installed alone in an empty environment, flies the simulator from another
# folder: what it needs is in it. PYTHON chooses the interpreter.
set -e
cd "$(dirname "$0")/.."
FOLDER=$(mktemp -d)
trap 'rm -rf "$FOLDER"' EXIT
"${PYTHON:-python3}" -m venv "$FOLDER/venv"
PIP=("$FOLDER/venv/bin/python" -m pip --quiet --disable-pip-version-check)
"${PIP[@]}" wheel --no-deps --wheel-dir "$FOLDER" .
"${PIP[@]}" install "$FOLDER"/landerd-*.whl
cd "$FOLDER"
venv/bin/landerd sim hover --seed 2
ls venv/lib/python3.*/site-packages/landerd/ardupilot_files/pixhawk-uart.param
