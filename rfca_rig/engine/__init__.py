"""Carries out a plan on the devices of a bench. Entry point: `run.run_plan`.

1. `arming` proves that the drive stops by itself.
2. `stages` carries out one stage after the other: `settling`, `cycling` and `ramp_up` belong to kinds of stages.
3. `loop` ticks: reads the devices, has `limit_monitor` check every limit, then commands the drive.
4. `stopping` is the one way a run stops, for a `stop_request` as for a trip.
5. `sink` takes what a stage measured; an `observer` sees every tick.
"""
