"""A walk while it happens: what of one tick is shown, as shapes, to Foxglove over a websocket and to RViz as topics."""
