"""Carries out a plan on the devices of a bench. Entry point: `run.run_plan`.

1. `run.prove_stop` proves that the drive stops by itself; `run.RampUp` checks what first strokes
   predict.
2. `stages` carries out one stage after the other, and waits for rest.
3. `loop` ticks: reads the devices, has `limit_monitor` check every limit, then commands the drive.
4. `stopping` is the one way a run stops, for a stop request as for a trip. Its `Sink` takes what a
   stage measured.

`loop_gaps` counts the times between ticks. `interfaces` defines what comes from outside: the bench,
stop requests, and observers, which see every tick.
"""
