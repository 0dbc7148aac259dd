"""Seeded runs of plant, controller and policy: one or many, their figures, training."""

from rabbit_common.threads import use_one_thread

use_one_thread()
