"""How the speed follows from step to step: learned from walks, used by `speed_regulation`."""
