"""The walk in the visitor's own browser: the tick as WebAssembly, MuJoCo's own module, and the page, in one folder."""
