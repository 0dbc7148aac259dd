"""Is a recording whole, and does it replay? Ticks that are not in it, and torques that do not come out again."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_bringup.recording.bag_writer import RecordingError
from rabbit_bringup.recording.opening import storage_files
from rabbit_bringup.recording.reader import RecordedEpisode, iterate_episodes
from rabbit_bringup.recording.replay import replay

BESIDE = "parameters.yaml"  # what `rabbit walk` leaves beside its recording


@dataclass(frozen=True)
class Checked:
    """An episode: its ticks, how many of them the recording has not in full, and how many were `replayed`.

    `differing` are the ticks whose torques did not come out, `furthest` (N m) the most that one was off.
    """

    number: int
    ticks: int
    lost: int
    replayed: int
    differing: list[int]
    furthest: float


def check_episodes(path: Path, law: ControllerParameters) -> Iterator[Checked]:
    """Check one episode after another; raises `RecordingError`."""
    for episode in iterate_episodes(path):
        beginning = up_to_gap(episode)
        try:
            again = np.array(list(replay(beginning, law))).reshape(-1, 4)
        except (PolicyFileError, ValueError) as error:
            raise RecordingError(f"recording {path}: episode {episode.number} cannot be replayed: {error}") from error
        torques = np.array([record.output.torque for record in beginning.records]).reshape(-1, 4)
        off = np.abs(torques - again).max(axis=1, initial=0.0)
        lost = episode.ticks - sum(record.state.tick < episode.ticks for record in episode.records)
        differing = np.flatnonzero((torques != again).any(axis=1)).tolist()
        yield Checked(episode.number, episode.ticks, lost, len(torques), differing, float(off.max(initial=0.0)))


def up_to_gap(episode: RecordedEpisode) -> RecordedEpisode:
    """The ticks from 0 to the first gap: a controller remembers, and cannot be replayed from elsewhere."""
    whole = [record for i, record in enumerate(episode.records) if record.state.tick == i]
    return replace(episode, records=whole)


def controller_parameters(recording: Path, given: Path | None = None) -> ControllerParameters:
    """The controller's, from the ROS parameter file `given`, or from the one beside the recording.

    Raises:
        RecordingError: no recording, no such file, or none for a controller in it.
    """
    path = given or storage_files(recording)[0].parent.with_name(BESIDE)
    try:
        nodes = yaml.safe_load(path.read_text(encoding="utf-8"))
        (values,) = [body["ros__parameters"] for name, body in nodes.items() if name.split("/")[-1] == "controller"]
        return ControllerParameters.model_validate({k: v for k, v in values.items() if k not in ("policy", "swap_at")})
    except OSError as error:
        raise RecordingError(
            f"parameters {path}: {error.strerror}; name the ROS parameter file that the controller was started with"
        ) from error
    except (
        ValidationError,
        yaml.YAMLError,
        UnicodeDecodeError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
    ) as error:
        raise RecordingError(f"parameters {path}: expected those of one controller: {error}") from error
