"""Training of the policy within the step: PPO or SAC over random plants, in the batch."""
