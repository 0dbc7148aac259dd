"""What nodes and commands share: options and ROS parameters, checks of messages, exit codes; `ros`: QoS."""
