"""Where the seven joints depart from a strip between stiff shells, and what either costs.

Run: python -m tests.benchmarks.beam

Also the discrete elastica against elliptic integrals, by angle of the tip.
"""

import numpy as np

from rfca_rig.model.paper.elastica import cantilever_tip
from rfca_rig.model.paper.hinge_curve import (
    HeldHinge,
    compute_fixed_curve,
    compute_sliding_curve,
    fit_hardening,
)
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from tests.benchmarks.__main__ import median_s
from tests.model.exact_beam import chain_tip, strip_between_shells
from tests.model.legs import LENGTHS
from tests.model.test_elastica import errors, loaded

STRIP = paper_strips(table_1_materials()[-1])
EI = STRIP.bending_stiffness_Nm2
LEG_M = sum(LENGTHS)


def main() -> None:
    _elastica()
    _hinges()
    for free_m in (EI / 10.98, 0.0393):
        _departure(free_m)
    _cost()


def _elastica() -> None:
    print(
        "cantilever, force at 90 or 135 degrees: error of tip place / length, and of tip "
        "slope, for N = 50 and 100, order, Richardson"
    )
    for direction, slope in [
        *((90, a) for a in (10, 30, 50, 70, 80)),
        *((135, a) for a in (30, 60, 90, 110)),
    ]:
        coarse = errors(direction, slope, 50)
        fine = errors(direction, slope, 100)
        force, place = loaded(direction, slope)
        tip = cantilever_tip(0.26, 0.226, force)
        best = np.hypot(tip.x_m - place[0], tip.y_m - place[1]) / 0.226
        order = np.log2(coarse / fine)
        print(
            f"{direction:4d} {slope:4d} {coarse[0]:9.1e} {coarse[1]:9.1e} {fine[0]:9.1e} "
            f"{fine[1]:9.1e} {order.round(2)} {best:9.1e}"
        )


def _hinges() -> None:
    print("one hinge, 0 to 45 degrees: fitted k0 [N m/rad] and k2")
    phi = np.radians(np.arange(1.0, 46.0))
    for free_m in (EI / 10.98, 0.0393):
        for offset_m in (0.0, 0.002, 0.005):
            pair = sum(
                compute_sliding_curve(HeldHinge(EI / 2, free_m, side * offset_m), phi).torque_Nm
                for side in (1, -1)
            )
            fixed = fit_hardening(
                phi, compute_fixed_curve(HeldHinge(EI, free_m, offset_m), phi).torque_Nm
            )
            slid = fit_hardening(phi, pair)
            print(
                f"free {1e3 * free_m:5.1f} mm, offset {1e3 * offset_m:3.1f} mm: sliding "
                f"pair at +- offset {slid[0]:6.2f} {slid[1]:6.3f}, "
                f"fixed on the inside {fixed[0]:6.2f} {fixed[1]:6.3f} (misfit "
                f"{100 * fixed[2]:.0f} %)"
            )


def _chains(free_m: float):
    k = EI / free_m
    plain = (lambda phi: 0.5 * k * phi**2, lambda phi: k * phi)
    hinge = HeldHinge(EI, free_m)
    slid = (
        lambda phi: compute_sliding_curve(hinge, phi).energy_J,
        lambda phi: compute_sliding_curve(hinge, phi).torque_Nm,
    )
    return plain, slid


def _departure(free_m: float) -> None:
    print(
        f"tip force on the leg, {1e3 * free_m:.1f} mm free at each hinge; tip of the "
        "chain with K = EI / free, and of that with the sliding"
    )
    print("curve, off the tip of the beam without pins, in % of the leg and degrees")
    laws = _chains(free_m)
    beam = strip_between_shells(STRIP, LENGTHS, free_m)
    for direction in (90, 135):
        for size_N in (0.5, 2.0, 5.0, 10.0, 20.0):
            force = size_N * np.array(
                [np.cos(np.radians(direction)), np.sin(np.radians(direction))]
            )
            tip = beam.bent(force)[-1]
            ends, angles = zip(*(chain_tip(LENGTHS, *law, force) for law in laws), strict=True)
            off = [
                (
                    f"{100 * np.hypot(*(end[:2] - tip[:2])) / LEG_M:6.2f} "
                    f"{np.degrees(end[2] - tip[2]):5.1f}"
                )
                for end in ends
            ]
            turned = (
                f"tip at {np.degrees(tip[2]):6.1f} deg, largest hinge "
                f"{np.degrees(angles[0].max()):5.1f} deg"
            )
            print(f"{direction:4d} deg {size_N:5.1f} N: {turned}; off by {off[0]} and {off[1]}")


def _cost() -> None:
    free_m = EI / 10.98
    force = np.array([0.0, 10.0])
    plain, slid = _chains(free_m)
    for name, work in (
        ("beam, 290 elements", lambda: strip_between_shells(STRIP, LENGTHS, free_m).bent(force, 5)),
        (
            "beam, 60 elements",
            lambda: strip_between_shells(STRIP, LENGTHS, free_m, 6e-3).bent(force, 5),
        ),
        ("seven joints", lambda: chain_tip(LENGTHS, *plain, force, 5)),
        ("seven joints, sliding curve", lambda: chain_tip(LENGTHS, *slid, force, 5)),
    ):
        print(f"{name:28} {1e3 * median_s(work, 5):8.1f} ms per static shape of five load steps")


if __name__ == "__main__":
    main()
