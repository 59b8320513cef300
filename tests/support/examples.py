"""Costly properties try fewer examples in CI and at a desk, and as many as others at night."""

from __future__ import annotations

from collections.abc import Collection

from hypothesis import HealthCheck, settings


def fewer(examples: int, suppress: Collection[HealthCheck] = ()) -> settings:
    """``examples`` instead of those of CI; all of the profile where that asks for more.

    suppress: health checks that the property is known to fail.
    """
    usual, profile = settings.get_profile("ci").max_examples, settings().max_examples
    return settings(
        max_examples=examples if profile <= usual else profile, suppress_health_check=suppress
    )
