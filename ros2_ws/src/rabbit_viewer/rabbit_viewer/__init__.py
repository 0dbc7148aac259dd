"""Pictures and films of a walk, and how all figures look; `live`: the same while it happens."""

from rabbit_common.threads import use_one_thread

use_one_thread()
