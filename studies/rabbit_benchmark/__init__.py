"""Methods by cells under one protocol: `rabbit benchmark` (studies/docs/benchmark.md)."""
