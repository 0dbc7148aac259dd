"""What the server of `forked` imports once for all nodes: their modules, and what these import only as they run."""

import torch._dynamo  # noqa: F401  by the first optimiser
from rabbit_common.ros.topics import TOPICS
from rabbit_recording.ros import recorder as recorder_node  # noqa: F401
from rabbit_sim.ros import node as simulator_node  # noqa: F401
from rl_cbf_clf_controller import node as controller_node  # noqa: F401
from rl_trainer.ros import node as trainer_node  # noqa: F401
from rosbags.typesys import Stores, get_typestore

get_typestore(Stores.ROS2_JAZZY)
for topic in TOPICS:
    topic.type.__import_type_support__()
