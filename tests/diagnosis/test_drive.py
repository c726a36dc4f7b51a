"""The search in the shaft's own motion, beside what was found in the forces."""

from dataclasses import replace

from rfca_rig.analysis.repeats import conditions_of
from rfca_rig.diagnosis.diagnose import SEEN_ON_THE_SHAFT, drive_found
from rfca_rig.diagnosis.turns import shaft_condition
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import RIG, body_of, flaps_of, found_among, present, recorded


def test_a_drive_that_sags_is_looked_for_though_the_forces_look_a_little_like_a_soft_shaft():
    rig = replace(RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=5.0, ki_Nm_per_rad=40.0),))
    strokes = recorded(rig, [(215.0, 2.433)])
    flaps = flaps_of(strokes)
    shafts = [shaft_condition(c, float(f.t_s[-1]), RIG.drive.ramp_s) for c, f in zip(conditions_of(strokes), flaps, strict=True)]
    leg = found_among(flaps, ["shaft_compliance"])
    soft = replace(leg, named=tuple(replace(h, log_prior=1e6) for h in leg.named))
    effects = [catalogue()[name] for name in SEEN_ON_THE_SHAFT]
    drive = drive_found(body_of(flaps, soft, shafts), soft, effects, lambda *_: None)
    assert drive.named[0].ids == ("motor_speed_droop",)
