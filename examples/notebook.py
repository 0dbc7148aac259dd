# %% [markdown]
# From a policy file to a paper's plots, in ten cells. Open it in an editor that knows `# %%` cells, or run
# `python examples/notebook.py --runs 4 --out figures`. Source the workspace first.

# %% 1. What to measure: how many courses, and where the figures go
import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import episode_seeds, record_walk, walk
from rabbit_experiments.summary import wilson
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from scipy.stats import binomtest

reader = argparse.ArgumentParser()
reader.add_argument("--runs", type=int, default=20)
reader.add_argument("--stones", type=int, default=20)
reader.add_argument("--out", type=Path, default=Path("figures"))
options, _ = reader.parse_known_args()
options.out.mkdir(parents=True, exist_ok=True)

# %% 2. The true robot has twice the mass of the controller's model; its motors lag by 4 ms
heavy = SimulationParameters(mass_scale=2.0, motor_lag=0.004, stones=options.stones)

# %% 3. A shipped policy, and the nominal controller; in place of the name, the path of your own file will do
parameters = load_parameters("ours", controller="rl-cbf-clf-qp")
learned = Assembly(heavy, parameters, resolve_policy("rl-cbf-clf-qp", parameters))
nominal = Assembly(heavy, load_parameters("ours", controller="cbf-clf-qp"), "zero")

# %% 4. Both walk the same courses: run i of either has the i-th seed
seeds = episode_seeds(9001, options.runs)
rows = {
    name: [walk(assembly, run, seed).row for run, seed in seeds.items()]
    for name, assembly in (("learned", learned), ("nominal", nominal))
}

# %% 5. Courses walked, with Wilson's 95% interval
for name, walks in rows.items():
    good = sum(row.success for row in walks)
    low, high = wilson(good, len(walks))
    print(f"{name}: {good} of {len(walks)} ({low:.2f} to {high:.2f}), {np.mean([r.stones for r in walks]):.1f} stones")

# %% 6. Paired comparison: of the courses that only one of them walks, does each have its half? (McNemar, exact)
pairs = [(a.success, b.success) for a, b in zip(rows["learned"], rows["nominal"], strict=True)]
only = [pairs.count((True, False)), pairs.count((False, True))]
p_value = binomtest(only[0], sum(only)).pvalue if sum(only) else 1.0
print(f"only learned: {only[0]}, only nominal: {only[1]}, p = {p_value:.2g}")

# %% 7. One course with all its ticks, by both controllers
one, other = (record_walk(assembly, seeds[0]) for assembly in (learned, nominal))

# %% 8. The estimates against the measured errors, some time after each impact (1: as bad as none)
late = np.flatnonzero((one.phase[:-1] > 0.2) & (np.diff(one.step_index) == 0))
true = one.measured[late + 1] - (np.einsum("tnm,tm->tn", one.nominal_a, one.mu) + one.nominal_b)[late]
wrong = (np.einsum("tnm,tm->tn", one.alpha, one.mu) + one.beta)[late] - true
errors = np.sqrt((wrong**2).mean(axis=0) / (true**2).mean(axis=0))
plt.bar(one.about["quantities"], errors)
plt.ylabel("rms error of the estimates / rms of the measured error")
plt.savefig(options.out / "estimates.pdf")

# %% 9. The figure: the CLF, the barriers, and the force's ratio with the cone's limit
figure, axes = plt.subplots(3, sharex=True, figsize=(6, 6))
for name, line, records in (("learned", "-", one), ("nominal", "--", other)):
    force = np.abs(records.stance_force[:, 0]) / np.maximum(records.stance_force[:, 1], 20.0)
    for axis, values in zip(axes, (records.V, records.barriers, force), strict=True):
        axis.plot(records.time, values, line, label=name if values.ndim == 1 else [f"B1 {name}", f"B2 {name}"])
for axis, label in zip(axes, ("V", "B1, B2 (m)", "|F_T| / F_N"), strict=True):
    axis.set_ylabel(label)
    axis.legend(fontsize="small")
axes[0].set_yscale("log")
axes[2].axhline(learned.controller.friction_coeff, color="black", linewidth=0.5)

# %% 10. Write it
axes[2].set_xlabel("time (s)")
figure.savefig(options.out / "walk.pdf")
figure.savefig(options.out / "walk.png")
print(f"written {options.out}/estimates.pdf, walk.pdf, walk.png")
