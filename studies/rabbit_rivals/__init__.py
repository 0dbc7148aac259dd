"""The field's methods beside this project's: end-to-end RL, and Gaussian processes with a cone programme."""

from rabbit_common.threads import use_one_thread

use_one_thread()
