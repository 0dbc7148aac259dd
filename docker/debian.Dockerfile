# RABBIT on Debian slim, with ROS 2 Jazzy as wheels. From the repository's root:
#   docker build -f docker/debian.Dockerfile -t rabbit .
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS environment
RUN apt-get update \
 && apt-get install -y --no-install-recommends build-essential ca-certificates cmake git python3-dev python3-venv
# The CPU build of torch, in place of 4 GB of CUDA; the locks hold the hash of either
ARG PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
ARG PIP_INDEX_URL
ARG PIP_FIND_LINKS
ARG PIP_CERT
ENV PIP_NO_CACHE_DIR=1
WORKDIR /opt/rabbit
# What the libraries depend on, so that an edit of anything else installs none again
COPY Makefile ./
COPY requirements requirements
COPY ros2_ws/stand_ins ros2_ws/stand_ins
COPY scripts/checks.py scripts/common.py scripts/mend_ros_wheels.py scripts/pip_install.py scripts/set_up.py scripts/
RUN make setup && .venv/bin/pip install --no-deps --require-hashes -r requirements/cluster.txt

FROM environment AS built
COPY . .
RUN make build && .venv/bin/python -m compileall -q ros2_ws/src && rm -r .venv

FROM ${BASE}
RUN apt-get update \
 && apt-get install -y --no-install-recommends libgomp1 python3 \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/*.bin \
 && useradd --create-home --shell /bin/bash rabbit \
 && install -d -o rabbit -g rabbit -m 1777 /walks /walks/runs
# Root's own: who breaks out of a node cannot change its code
COPY --from=environment /opt/rabbit/.venv /opt/rabbit/.venv
COPY --from=built /opt/rabbit /opt/rabbit
USER rabbit
WORKDIR /walks
ENTRYPOINT ["/opt/rabbit/docker/entrypoint.sh"]
CMD ["rabbit", "walk"]
