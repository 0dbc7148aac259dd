"""From encoders, an IMU and foot contact to the robot's state."""
