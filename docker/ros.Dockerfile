# RABBIT on the official ROS 2 Jazzy, with the whole `ros2` command line. From the repository's root:
#   docker build -f docker/ros.Dockerfile -t rabbit:ros .
ARG BASE=ros:jazzy

FROM ${BASE}
RUN apt-get update \
 && apt-get install -y --no-install-recommends \
      build-essential cmake git python3-colcon-common-extensions python3-dev python3-venv \
      ros-jazzy-rosbag2 ros-jazzy-rosbag2-storage-mcap ros-jazzy-tf2-msgs ros-jazzy-visualization-msgs \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home --shell /bin/bash rabbit \
 && install -d -o rabbit -g rabbit -m 1777 /walks /walks/runs
ARG PIP_INDEX_URL
ARG PIP_CERT
ENV PIP_NO_CACHE_DIR=1
WORKDIR /opt/rabbit
# What the libraries depend on, so that an edit of anything else installs none again
COPY Makefile ./
COPY requirements requirements
COPY scripts/checks.py scripts/common.py scripts/mend_ros_wheels.py scripts/pip_install.py scripts/set_up.py scripts/
RUN make setup PYTHON=/usr/bin/python3 && .venv/bin/pip install --no-deps --require-hashes -r requirements/cluster.txt
COPY . .
RUN make build && .venv/bin/python -m compileall -q ros2_ws/src
USER rabbit
WORKDIR /walks
ENTRYPOINT ["/opt/rabbit/docker/entrypoint.sh"]
CMD ["rabbit", "walk"]
