"""A walking graph on the page and through RViz's topics, against the recording."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from page_client import PageClient, free_port
from rabbit_command import RABBIT
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED
from rabbit_recording.reader import read_episodes
from rl_trainer.rollout import Record

WALK = ("--no-pictures", "--no-video", "--no-trainer", "--stones", "4", "--seed", "4", "--view")


class Seen:
    """What a client saw of a walk, by tick, and what was recorded of it."""

    def __init__(self, folder: Path) -> None:
        port = free_port()
        command = [*RABBIT, "walk", "--out", str(folder), *WALK, "--view-port", str(port)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        with PageClient(f"http://127.0.0.1:{port}", timeout=300, watches=False) as client:
            while process.poll() is None:
                client.hear(0.5)
        self.about = client.words["about"]
        self.refused = client.words.get("refused")
        self.rows = {int(row[0]["tick"]): row[0] for row in client.rows}
        self.said, errors = process.communicate()
        assert process.returncode == 0, errors
        self.records: dict[int, Record] = {
            record.state.tick: record for record in read_episodes(folder / "recording")[1].records
        }


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """One walk at the pace of real time, for all tests here."""
    return Seen(tmp_path_factory.mktemp("viewed") / "walk")


def test_rows_are_the_recorded_ticks(seen: Seen) -> None:
    assert len(seen.rows) >= 10
    for tick, row in seen.rows.items():
        record = seen.records[tick]
        output, force = record.output, record.state.foot_force[record.output.stance]
        assert row["V"] == np.float32(output.V)
        np.testing.assert_array_equal([row["B1"], row["B2"]], output.barriers.astype(np.float32))
        np.testing.assert_array_equal([row["F_T"], row["F_N"]], force.astype(np.float32))
        applied = seen.records[tick - 1].output.torque if tick else np.full(4, np.nan)  # over the tick that ended
        torque = [row[f"torque_{joint}"] for joint in ACTUATED]
        np.testing.assert_array_equal(torque, applied.astype(np.float32))
        ratio = force_ratio(force)
        np.testing.assert_array_equal(row["force_ratio"], np.float32(ratio))
