"""How hypothesis runs here: the same few examples every time, however slow the machine."""

from hypothesis import HealthCheck, settings

few = settings(
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
