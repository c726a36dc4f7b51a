"""The paper's equations as they are written, section by section, and its strip. No simulation of a
stroke needs them.

1. `elastica`, `equivalent_stiffness` and `hinge_curve` compute the bent strip.
2. `strip` holds its materials, and divides a leg into another number of links.
3. `statics` has eqs. (9)-(10), `dynamics` eqs. (11)-(13) and (16), and `rigid_floor` eqs.
   (14)-(15).
"""
