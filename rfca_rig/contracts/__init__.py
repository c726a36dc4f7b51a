"""What every driver must do, as tests that a lab runs on drivers of its own. Needs pytest."""

import pytest

pytest.register_assert_rewrite(
    *(f"{__name__}.{module}" for module in ("force_sensor", "force_sensor_rig", "motor", "motor_moves", "motor_stops", "rotor"))
)
