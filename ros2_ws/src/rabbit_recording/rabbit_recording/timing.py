"""How a walk kept real time, from its recording: late ticks, missed deadlines, the age of the torque that acted."""

from pathlib import Path
from typing import Any

import numpy as np
from rabbit_sim.real_time import LATE_SECONDS, Source

from rabbit_recording.reader import messages

PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}


def real_time_figures(recording: Path) -> dict[str, Any] | None:
    """Figures over all ticks, times in ms; None of a walk in lock-step.

    `late`: from when a tick should have ended to when it was simulated; `response`: from its state going out to its
    torque coming in; `age`: of what acted, from the state that it answers going out to the end of the tick, 10 ms when
    all is well. Raises `RecordingError`.
    """
    rows = [(m.late, m.response, m.age, m.source) for _, m in messages(recording, "timing")]
    if not rows:
        return None
    late, response, age, source = np.array(rows, dtype=float).T
    return {
        "ticks": len(rows),
        "late_share": float(np.mean(late > LATE_SECONDS)),
        "missed": int(np.sum(source != Source.ANSWER)),
        "damped": int(np.sum(source == Source.DAMPING)),
        "late_ms": _percentiles(late),
        "response_ms": _percentiles(response),
        "age_ms": _percentiles(age),
    }


def _percentiles(seconds: Any) -> dict[str, float]:
    known = seconds[np.isfinite(seconds)] * 1e3
    return {name: float(np.percentile(known, q)) if len(known) else float("nan") for name, q in PERCENTILES.items()}
