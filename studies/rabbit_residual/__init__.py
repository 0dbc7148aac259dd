"""Training of the policy within the step: PPO over random plants, in the batch."""
