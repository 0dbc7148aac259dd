"""The true plant: RABBIT on stepping stones, with perturbations the controller does not know of."""
