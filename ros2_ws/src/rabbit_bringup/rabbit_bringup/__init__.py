"""What brings the graph up: launch files, configuration, the launcher, the `rabbit` command."""

from rabbit_common.threads import use_one_thread

use_one_thread()
