"""Sweeps: any parameters of the model over grids or samples, any outputs; see `quantities` and `outputs` for what there is."""
