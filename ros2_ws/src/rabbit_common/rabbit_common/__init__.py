"""What the nodes share: parameters, QoS, checks of every message, conversions, diagnostics."""
