"""Files that people write: rig, protocol, camera, model. Entry points: `rig_file.read_rig`,
`planning.read_plan`, `model_file`.

`sections` are pydantic models with units in their keys; those of devices are in `rfca_rig.devices`.
`nominal_model` converts them to the model's parameters.
"""
