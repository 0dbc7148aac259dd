"""Faults injected into a running graph, and what must hold after each."""
