"""Writing and reading recordings of the graph."""
