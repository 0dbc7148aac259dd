"""Where the page is served, and what may be wrong with that."""

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")  # of this machine, that a browser may ask for
PORT = 8765


class PageError(RuntimeError):
    """The page cannot be served or written; one line that says why."""
