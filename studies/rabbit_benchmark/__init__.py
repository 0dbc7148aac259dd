"""Methods by cells under one protocol: `rabbit benchmark` (docs/benchmark.md)."""
