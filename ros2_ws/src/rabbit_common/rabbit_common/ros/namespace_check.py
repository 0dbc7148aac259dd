"""Is somebody there already? Two graphs in one namespace are two robots in one: either ends the other's episodes."""

import hashlib
import socket
import time
from collections.abc import Callable, Collection

import rclpy
from rclpy.node import Node

from rabbit_common.executables import Refused
from rabbit_common.ros.network import domain, joined
from rabbit_common.ros.topics import TOPICS

DISCOVERY_SECONDS = 1.0  # within which nodes find each other
POLL_SECONDS = 0.1
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of an end point that is discovered before its node


def hold_name(name: str) -> socket.socket:
    """Holds a name of the ROS domain on this machine, until it is closed or the process ends.

    It is a socket's name that belongs to no file, so that nothing is left of a process that was killed. Raises
    `OSError` while somebody holds it, `StartError` where there is no such domain.
    """
    key = hashlib.sha256(f"{domain()} {name}".encode()).hexdigest()  # a socket's name has 107 characters at most
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0rabbit/{key}")
    except OSError:
        holder.close()
        raise
    return holder


class NamespaceCheck:
    """Holds a namespace of the ROS domain for one walk of this machine, until it is closed or the process ends."""

    def __init__(self, namespace: str) -> None:
        """Raises `Refused` while another process holds the namespace, or there is no such domain."""
        self._namespace = f"/{namespace.strip('/')}"
        self._where = f"namespace {self._namespace} of ROS domain {domain()}"
        try:
            self._held = hold_name(self._namespace)
        except OSError as error:
            raise self._refusal("another walk has begun") from error

    def close(self) -> None:
        """Let others have it."""
        self._held.close()

    def look(self, nodes: Collection[str], seconds: float = DISCOVERY_SECONDS) -> None:
        """Look for a graph that nobody claimed, as nodes started one by one, for so many s. Raises `Refused`.

        `nodes`: those to be started. Nobody else may publish on their topics.
        """
        with joined("/rabbit/launcher") as context:
            node = rclpy.create_node("launcher", namespace=self._namespace, context=context)
            topics = [node.resolve_topic_name(topic.name) for topic in TOPICS if topic.publisher in nodes]
            if clash := first_published(node, topics, 0, seconds):
                raise self._refusal(f"{publishers(node, clash, seconds)} publishes {clash}")

    def _refusal(self, what: str) -> Refused:
        return Refused(f"{self._where}: {what}; end that graph, or take another --namespace or ROS_DOMAIN_ID")


def first_published(node: Node, topics: Collection[str], ours: int, seconds: float) -> str:
    """The first of `topics`, by full name, that has more than `ours` publishers within so many s; empty if none has."""
    return _discovered(lambda: next((topic for topic in topics if node.count_publishers(topic) > ours), ""), seconds)


def publishers(node: Node, topic: str, seconds: float) -> str:
    """The names of the nodes that publish on `topic`; "a node" if none becomes known within so many s."""

    def names() -> str:
        return ", ".join(sorted({info.node_name for info in node.get_publishers_info_by_topic(topic)} - {UNKNOWN}))

    return _discovered(names, seconds) or "a node"


def _discovered(look: Callable[[], str], seconds: float) -> str:
    """What `look` says within so many s."""
    end = time.monotonic() + seconds
    while not (names := look()) and time.monotonic() < end:
        time.sleep(min(POLL_SECONDS, seconds))
    return names
