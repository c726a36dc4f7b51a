"""Converts the sections of a file, in the files' units, to the model's parameters in SI."""

import math
from collections.abc import Mapping
from typing import Any

from rfca_rig.description.sections import DriveSection, GroundSection, LegSection, RigSections, SensorSection
from rfca_rig.description.toml import validate
from rfca_rig.description.torque_rotation import splines_of
from rfca_rig.model.parameters import Drive, Ground, Leg, RigModel, SensorMount, TorqueSpline


def nominal_model(sections: Mapping[str, Any]) -> RigModel:
    """The model that the sections leg, ground, sensor and drive describe.

    `sections` is plain data in the file's own units, as in `Recording.nominal`. Raises BadInput, naming the key, where something is
    missing, unknown or out of range.
    """
    return model_of(validate(sections, RigSections, "the nominal model"))


def model_of(sections: RigSections) -> RigModel:
    """The model from sections that were validated before."""
    effects = tuple(effect.present() for effect in sections.effects)
    return RigModel(_leg(sections.leg), _ground(sections.ground), _sensor(sections.sensor), _drive(sections.drive), effects)


def _leg(leg: LegSection) -> Leg:
    if leg.torque_rotation is None:
        assert leg.k0_Nm_per_rad is not None
        assert leg.k2_per_rad2 is not None
        k0_Nm_per_rad, k2_per_rad2 = leg.k0_Nm_per_rad, leg.k2_per_rad2
        splines: tuple[TorqueSpline, ...] = ()
    else:
        # The hardening is part of the measured curve; k0 only scales it.
        k2_per_rad2 = 0.0
        k0_Nm_per_rad, splines = splines_of(leg.torque_rotation)
    return Leg(
        link_lengths_m=tuple(length_mm / 1e3 for length_mm in leg.link_lengths_mm),
        link_masses_kg=tuple(mass_g / 1e3 for mass_g in leg.link_masses_g),
        link_radius_m=leg.link_radius_mm / 1e3,
        k0_Nm_per_rad=k0_Nm_per_rad,
        k2_per_rad2=k2_per_rad2,
        hinge_damping_Nm_s_per_rad=leg.hinge_damping_Nm_s_per_rad,
        start_angle_rad=leg.start_angle_rad,
        rest_angles_rad=tuple(map(math.radians, leg.rest_angles_deg or ())),
        torque_splines=splines,
    )


def _ground(ground: GroundSection) -> Ground:
    return Ground(
        stiffness_N_per_m1p5=ground.contact_stiffness_N_per_m1p5,
        damping_s_per_m=ground.contact_damping_s_per_m,
        friction_coefficient=ground.friction_coefficient,
        presliding_m=ground.presliding_mm / 1e3,
        drag_N_s_per_m=ground.tangential_damping_N_s_per_m,
        friction_lever_m=None if ground.friction_lever_mm is None else ground.friction_lever_mm / 1e3,
        friction_rise_share=ground.friction_rise_share,
        leaving_damping_share=ground.leaving_damping_share,
    )


def _sensor(sensor: SensorSection) -> SensorMount:
    return SensorMount(below_shaft_m=sensor.below_shaft_mm / 1e3)


def _drive(drive: DriveSection) -> Drive:
    return Drive(ramp_s=drive.ramp_s, holds_start=drive.holds_start)
