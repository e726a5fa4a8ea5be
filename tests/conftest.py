"""Settings that every test shares."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# Derandomised, so that a red run can be run again; no deadline, since the machines are shared.
settings.register_profile("froxel_ref", deadline=None, derandomize=True,
                          suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("froxel_ref")
