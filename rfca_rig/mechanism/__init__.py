"""A mechanism of hinges and slides that MuJoCo simulates, with the physics that its model may lack.

1. `load.load_mechanism`: an MJCF or URDF file becomes a `Mechanism`.
2. `plant.Plant`: one version of it, which effects and nuisance parameters change.
3. `rollout.simulate_plant`: the plant's motion from a start under recorded commands.
4. `usual_motion.measure_usual_motion` and `effects.list_effects`: the effects for the joints of a
   mechanism, with plausible sizes.
5. `inverse_dynamics`: `balance_torques` of recorded states, and `compute_feed_forward` of a planned
   motion.
6. `model_files.write_amended_model`: the model file with the result of a diagnosis.

MuJoCo is an optional dependency, which the diagnosis uses through this package only.
"""
