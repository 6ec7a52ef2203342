#!/bin/sh
# `tools/debian_root.sh DIR`: a Debian 13 in DIR with its Python 3.13 and its torch, which is built without CUDA, and in
# DIR/opt/lerobot the newest LeRobot as requirements/lerobot-debian.txt pins it. Needs root, and `apt-get install mmdebstrap`.
set -eu
root=$1
lock=requirements/lerobot-debian.txt
cmp -s "$lock" "$root/opt/lock.txt" && exit 0
if [ ! -e "$root/usr/bin/python3" ]; then
    mmdebstrap --variant=minbase --include=python3,python3-torch,python3-torchvision trixie "$root.partial"
    mv "$root.partial" "$root"
fi
rm -rf "$root/opt/lerobot"
.venv/bin/python -m uv pip install --quiet --no-deps --require-hashes --python-version 3.13 \
    --python-platform x86_64-manylinux_2_36 --target "$root/opt/lerobot" -r "$lock"
cp "$lock" "$root/opt/lock.txt"
