"""Live view of a run, or replay of a recording, in the browser. Entry points: `run_queue.LiveView`
and `replay.replay`.

A run puts its ticks into `run_queue`. A separate `process` reads them and serves pages (`server`).
`replay` plays recordings through the same interface, `messages.Feed`. What the model expects comes
from `leg_pose` and `expected_force`, both computed in the view's process.
"""
