"""Nodes here find those of this test process alone."""

import os

from rabbit_common.ros.network import choose_network

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
choose_network()
