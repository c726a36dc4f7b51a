"""Conformance tests for drivers, which a lab runs on its plug-ins. Needs pytest."""

import pytest

# Assertions outside of test files show their values only if the modules are registered before their
# import.
pytest.register_assert_rewrite(
    *(f"{__name__}.{module}" for module in ("force_sensor", "motor", "motor_rig"))
)
