"""Seeded runs of plant, controller and policy: metrics, ablations; `reproduce`: the paper's claims."""

from rabbit_common.threads import use_one_thread

use_one_thread()
