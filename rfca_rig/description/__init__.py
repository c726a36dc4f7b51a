"""Files that people write: rig, protocol, camera, model. Entry points: `rig_file.read_rig`, `planning.read_plan`, `model_file`.

`sections` and the other sections are pydantic models with units in their keys; `nominal_model` converts them to the model's parameters.
"""
