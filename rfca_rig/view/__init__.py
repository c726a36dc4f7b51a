"""Live view of a run, or replay of a recording, in the browser. Entry points: `live_view.LiveView` and `replay.replay`.

A run puts its ticks into `run_queue`. A separate process (`process`) reads them in `live_source` and serves pages (`server`).
`replay` plays recordings through the same interface, `messages.Feed`.
"""
