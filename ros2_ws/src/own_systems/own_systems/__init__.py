"""A control task in one file, and what follows from it: rides, training, tables, pictures, films, recordings, nodes."""

from rabbit_description.task import Commands, ControlTask, Disc, Impact, Limit, Line, Shape, TaskError

__all__ = ["Commands", "ControlTask", "Disc", "Impact", "Limit", "Line", "Shape", "TaskError"]
