"""How far the state estimator is from the truth, and whether it knows: `rabbit estimator` (docs/estimator.md)."""
