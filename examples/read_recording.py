# %% [markdown]
# Reading a recording in a notebook: `python examples/read_recording.py BAG`. No node runs, no simulation is made again.

# %% A recording is a folder that `rabbit walk` or `rabbit bag record` wrote
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rabbit_recording.reader import iterate_episodes

bag = Path(sys.argv[1])

# %% One episode at a time; each tick has the state that was measured and all that the controller made of it
for episode in iterate_episodes(bag):
    print(
        f"episode {episode.number}: {episode.outcome}, {len(episode.records)} ticks, {len(episode.landings)} landings"
    )

    # %% Arrays over the ticks: names, shapes and units are those of `RobotState` and `ControllerOutput`
    ticks = np.array([tick.state.tick for tick in episode.records])
    pitch = np.array([tick.state.q[2] for tick in episode.records])  # rad
    V = np.array([tick.output.V for tick in episode.records])
    torque = np.array([tick.output.torque for tick in episode.records])  # (n, 4), N m

    # %% Which policy decided each tick: a swap shows as a change
    print("policies:", sorted({tick.output.policy_version for tick in episode.records}))

    # %% Plot
    figure, axes = plt.subplots(3, sharex=True)
    for axis, values, label in zip(axes, (V, pitch, torque), ("V", "pitch (rad)", "torque (N m)"), strict=True):
        axis.plot(0.01 * ticks, values)
        axis.set_ylabel(label)
    axes[2].set_xlabel("time (s)")
    figure.savefig(bag.parent / f"{bag.name}-episode-{episode.number}.png")
    plt.close(figure)
