"""A walk while it happens: what of one tick is shown, on the page and as topics for RViz."""
