"""What the nodes share: parameters, QoS, the door every message passes, conversions, diagnostics."""
