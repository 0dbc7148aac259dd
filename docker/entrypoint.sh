#!/usr/bin/env bash
# Puts the workspace on the path, then becomes the command.
set -eo pipefail
source /opt/rabbit/ros2_ws/install/setup.bash
exec "$@"
