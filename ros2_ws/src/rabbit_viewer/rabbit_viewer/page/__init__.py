"""The page in the browser: the same for a simulated robot, a running graph, a recording, and a file without a server.

`rows`: a tick as numbers. `server`: what browsers get and say. `export`: all of it in one HTML file.
"""
