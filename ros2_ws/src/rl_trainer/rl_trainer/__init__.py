"""The trainer's library: transitions, reward, learners and the episode loop. No ROS, no plant, no oracle in here."""
