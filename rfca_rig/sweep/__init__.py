"""Sweeps: any parameters of the model over grids or samples, with any outputs; `quantities` and `outputs` list them."""
