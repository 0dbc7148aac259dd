"""For maintainers: soak, jitter and benchmarks of the running graph."""

from rabbit_common.threads import use_one_thread

use_one_thread()
