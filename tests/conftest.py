"""Profiles of hypothesis: `make fuzz` chooses `fuzz`, which runs every fuzz test much longer."""

from hypothesis import HealthCheck, settings

SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture)

settings.register_profile("default", deadline=None, max_examples=100)
settings.register_profile("fuzz", deadline=None, max_examples=1500, suppress_health_check=SLOW)
settings.load_profile("default")
