"""Costly properties try fewer examples in CI and at a desk, and as many as others at night."""

from __future__ import annotations

from collections.abc import Collection

from hypothesis import HealthCheck, settings


def is_night() -> bool:
    """Whether the profile asks for more examples than CI."""
    return settings().max_examples > settings.get_profile("ci").max_examples


def fewer(examples: int, suppress: Collection[HealthCheck] = ()) -> settings:
    """``examples`` instead of those of CI; all of the profile where that asks for more.

    suppress: health checks that the property is known to fail.
    """
    count = settings().max_examples if is_night() else examples
    return settings(max_examples=count, suppress_health_check=suppress)
