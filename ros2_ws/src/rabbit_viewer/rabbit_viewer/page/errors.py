"""What is wrong with a page."""


class PageError(RuntimeError):
    """The page cannot be served or written; one line that says why."""
