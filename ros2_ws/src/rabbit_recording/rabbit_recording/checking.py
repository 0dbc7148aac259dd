"""Is a recording whole, and does it replay? Ticks that are not in it, and torques that do not come out again."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_recording.bag_writer import RecordingError
from rabbit_recording.reader import RecordedEpisode, iterate_episodes
from rabbit_recording.replay import replay


@dataclass(frozen=True)
class Checked:
    """An episode, what of it is in the recording, and how many of its ticks were `replayed`.

    `differing` are the ticks whose torques did not come out, `furthest` (N m) the most that one was off.
    """

    episode: RecordedEpisode
    replayed: int
    differing: list[int]
    furthest: float


def check_episodes(path: Path, law: ControllerParameters | None = None) -> Iterator[Checked]:
    """Check one episode after another, by the recorded settings or by `law`; raises `RecordingError`."""
    for episode in iterate_episodes(path):
        beginning = up_to_gap(episode)
        try:
            again = np.array(list(replay(beginning, law)) if beginning.records else []).reshape(-1, 4)
        except (PolicyFileError, ValueError) as error:
            raise RecordingError(f"recording {path}: episode {episode.number} cannot be replayed: {error}") from error
        torques = np.array([record.output.torque for record in beginning.records]).reshape(-1, 4)
        off = np.abs(torques - again).max(axis=1, initial=0.0)
        differing = np.flatnonzero((torques != again).any(axis=1)).tolist()
        yield Checked(episode, len(torques), differing, float(off.max(initial=0.0)))


def up_to_gap(episode: RecordedEpisode) -> RecordedEpisode:
    """The ticks from 0 to the first gap: a controller remembers, and cannot be replayed from elsewhere."""
    whole = [record for i, record in enumerate(episode.records) if record.state.tick == i]
    return replace(episode, records=whole)


def controller_parameters(path: Path) -> ControllerParameters:
    """The controller's, from the ROS parameter file that it was started with.

    Raises:
        RecordingError: no such file, or none for a controller in it.
    """
    try:
        nodes = yaml.safe_load(path.read_text(encoding="utf-8"))
        (values,) = [body["ros__parameters"] for name, body in nodes.items() if name.split("/")[-1] == "controller"]
        return ControllerParameters.model_validate(
            {k: v for k, v in values.items() if k in ControllerParameters.model_fields}
        )
    except OSError as error:
        raise RecordingError(f"parameters {path}: {error.strerror}") from error
    except (
        ValidationError,
        yaml.YAMLError,
        UnicodeDecodeError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
        RecursionError,
    ) as error:
        raise RecordingError(f"parameters {path}: expected those of one controller: {error}") from error
