"""Recordings of a leg with an effect of your own, for a nominal model without it: does a
diagnosis find the effect?
"""

from pathlib import Path

import numpy as np

import rfca_rig as rr

EFFECT = """
[[effects]]
id = "cubic_damping"
parameters = { coefficient_Nm_s3_per_rad3 = 0.08 }
"""
NOISE = {"fy_N": 0.10, "fz_N": 0.12, "tx_Nm": 0.006}

rig = Path("our-rig.toml").read_text(encoding="utf-8")
Path("with-effect.toml").write_text(rig + EFFECT, encoding="utf-8")
folder = Path("trial")
random = np.random.default_rng(1)
folder.mkdir(exist_ok=True)
# The nominal model: the sections of the rig file before its limits.
nominal = rig[rig.index("[leg]") : rig.index("[limits]")]
campaign = f'format = "rfca-campaign/1"\ntitle = "Trial of an effect"\n\n{nominal}'
for height_mm in (195, 215, 235):
    for speed_rad_s in (1.6, 2.433, 3.25):
        stroke = rr.simulate("with-effect.toml", height_mm=height_mm, speed_rad_s=speed_rad_s)
        simulated = stroke.to_xarray()[["shaft_angle_rad", *NOISE]].to_dataframe().reset_index()
        for repeat in (1, 2, 3):
            recorded = simulated.copy()
            for name, std in NOISE.items():
                recorded[name] += std * random.standard_normal(len(recorded))
            file = f"{height_mm}-{speed_rad_s}-{repeat}.csv"
            recorded.to_csv(folder / file, index=False)
            campaign += f'\n[[runs]]\nexperiment = "dynamic"\nfile = "{file}"\n'
            campaign += f"height_mm = {height_mm}\nspeed_rad_s = {speed_rad_s}\n"
            campaign += f"repeat = {repeat}\n"
(folder / "campaign.toml").write_text(campaign, encoding="utf-8")
